# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What a wrench sensor at a robot's tool measures beside the contact: its offset, and the tool.

    measured = F_c + offset + (m Rᵀ g, c × m Rᵀ g)

in the sensor's axes R, with the mass m of what is beyond the sensor and its centre of mass c. What
the tool's acceleration adds is not modelled.
"""

from __future__ import annotations

from collections import deque

import numpy as np

from hapticmech_ros.arrays import Array
from hapticmech_ros.errors import HapticMechError, InvalidInputError

EARTH = np.array([0.0, 0.0, -9.81])
# Samples that a tare averages over, at most and at least; rates of joints at rest, rad/s or m/s.
MOST, LEAST, REST = 100, 10, 0.02


class WrenchSensor:
    """Corrects a sensor's samples, and finds its offset while nothing touches the tool.

    Args:
        mass: of the tool beyond the sensor, kg.
        centre: (3,) its centre of mass, m, from the operational point in its axes.
        offset: (6,) measured without load and tool, N and N m, in its axes.
        gravity: (3,) m/s², world axes.

    Attributes:
        offset: as above; :meth:`tare` replaces it.

    Raises:
        InvalidInputError: a mass that is negative, or numbers that are not finite or too few.
    """

    def __init__(
        self,
        mass: float = 0.0,
        centre: Array = np.zeros(3),  # noqa: B008
        offset: Array = np.zeros(6),  # noqa: B008
        gravity: Array = EARTH,
    ) -> None:
        if not (np.isfinite(mass) and mass >= 0.0):
            raise InvalidInputError("tool_mass", mass, "must be a number of 0 or more")
        for name, values, size in (("tool_centre", centre, 3), ("sensor_offset", offset, 6)):
            if np.shape(values) != (size,) or not np.isfinite(values).all():
                raise InvalidInputError(name, values, f"must be {size} finite numbers")
        self._mass, self._centre = mass, np.array(centre, dtype=float)
        self._gravity = np.array(gravity, dtype=float)
        self.offset = np.array(offset, dtype=float)
        self._recent: deque[Array] = deque(maxlen=MOST)

    def weight(self, rotation: Array) -> Array:
        """Return what the tool's weight adds (6,), N and N m, in the sensor's axes.

        Args:
            rotation: (3, 3) R, from the sensor's axes to the world's.
        """
        force = self._mass * (rotation.T @ self._gravity)
        return np.concatenate((force, np.cross(self._centre, force)))

    def contact(self, measured: Array, rotation: Array) -> Array:
        """Return F_c (6,), N and N m, in the sensor's axes.

        Args:
            measured: (6,) by the sensor, N and N m, in its axes.
            rotation: (3, 3) R.
        """
        return np.asarray(measured - self.offset - self.weight(rotation))

    def record(self, measured: Array) -> None:
        """Take a sample for the next tare.

        Args:
            measured: (6,) by the sensor, N and N m, in its axes.
        """
        self._recent.append(np.array(measured, dtype=float))

    def tare(self, rotation: Array, rates: Array) -> None:
        """Take the mean of the last samples as those of a tool that touches nothing.

        Args:
            rotation: (3, 3) R.
            rates: (nv,) of the joints, rad/s or m/s.

        Raises:
            HapticMechError: too few samples, or a robot that moves.
        """
        if len(self._recent) < LEAST:
            raise HapticMechError(f"{len(self._recent)} samples of the sensor; {LEAST} are needed")
        fastest = float(np.abs(rates).max())
        if fastest > REST:
            raise HapticMechError(f"the robot moves: {fastest:.3g}, must be at most {REST:g} rad/s")
        self.offset = np.mean(self._recent, axis=0) - self.weight(rotation)
