# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Environments of a robot's tool: a spring and damper, or a mass on them behind a contact."""

from __future__ import annotations

from dataclasses import asdict, dataclass

import numpy as np

from hapticmech_ros.errors import check_not_negative
from hapticmech_ros.numerics import Array

# Of the contact between tool and a mass, N/m and N s/m.
CONTACT = 20e3, 40.0


@dataclass(frozen=True, slots=True)
class Impedance:
    """A linear environment along a line: F = -E(s) x, by the environment, on the robot.

    Attributes:
        stiffness: K, N/m.
        damping: B, N s/m.
        mass: M, kg; 0: none, and the tool is fixed to spring and damper themselves.

    Raises:
        InvalidInputError: one is negative or not finite.
    """

    stiffness: float = 0.0
    damping: float = 0.0
    mass: float = 0.0

    def __post_init__(self) -> None:
        check_not_negative(**asdict(self))

    def dynamic_stiffness(self, s: Array) -> Array:
        """Return E(s) (k,), N/m: K + B s, or with a mass that of both in series with its contact.

        Args:
            s: (k,) complex, 1/s.
        """
        own = self.mass * s**2 + self.damping * s + self.stiffness
        if self.mass == 0.0:
            return np.asarray(own)
        contact = CONTACT[0] + CONTACT[1] * s
        return np.asarray(contact * own / (contact + own))


class LinearEnvironment:
    """An impedance along a line through where the tool was first.

    Args:
        impedance: along the line.
        direction: (3,) unit vector of it, world axes.

    Attributes:
        force: (3,) by it, on the robot, over the last step, N, world axes.
    """

    def __init__(self, impedance: Impedance, direction: Array) -> None:
        self._impedance, self._direction = impedance, np.array(direction, dtype=float)
        self._start: Array | None = None
        self._place = self._rate = 0.0
        self.force = np.zeros(3)

    def advance(self, place: Array, rate: Array, step: float) -> Array:
        """Return the force (3,) on the robot over a step, N, world axes.

        Args:
            place: (3,) of the operational point, m, world axes.
            rate: (3,) of it, m/s.
            step: s.
        """
        if self._start is None:
            self._start = np.array(place)
        has = self._impedance
        x = float(self._direction @ (place - self._start))
        v = float(self._direction @ rate)
        if has.mass == 0.0:
            pushed = -has.stiffness * x - has.damping * v
        else:
            pushed = CONTACT[0] * (self._place - x) + CONTACT[1] * (self._rate - v)
            own = -has.stiffness * self._place - has.damping * self._rate
            self._rate += step * (own - pushed) / has.mass
            self._place += step * self._rate
        self.force = pushed * self._direction
        return self.force
