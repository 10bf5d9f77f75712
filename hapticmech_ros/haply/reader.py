# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Reads the cursor of an Inverse3, and commands no force.

How the base of a device stands in the world, from movements along two axes of the world.
"""

from __future__ import annotations

import time
from contextlib import ExitStack
from dataclasses import dataclass

import numpy as np
import pinocchio as pin
from scipy.spatial.transform import Rotation

from hapticmech_ros.errors import HapticMechError, InvalidInputError
from hapticmech_ros.haply.messages import (
    Cursor,
    Link,
    LinkError,
    cursor_of,
    force_command,
    found_in,
    greeting,
    parsed,
)
from hapticmech_ros.numerics import Array

# A movement is at least so long, m, and the two are within this of a right angle, rad.
SHORTEST, SKEWEST = 0.05, np.deg2rad(15.0)


@dataclass(frozen=True, slots=True)
class Mounting:
    """How a device's base stands in the world.

    Attributes:
        rotation: (3, 3) axes of the base in the world.
        skew: rad, by which the angle between the two movements differs from a right one.
    """

    rotation: Array
    skew: float

    @property
    def angles(self) -> tuple[float, float, float]:
        """Roll, pitch and yaw, rad, as the node's parameters take them."""
        roll, pitch, yaw = pin.rpy.matrixToRpy(self.rotation)
        return float(roll), float(pitch), float(yaw)


def mounting_of(start: Array, along_x: Array, along_y: Array) -> Mounting:
    """Return the rotation that fits two movements best, in the sense of least squares.

    With unit vectors d₁, d₂ of the movements, R maximises x · R d₁ + y · R d₂ (Wahba's problem, by
    the singular value decomposition: F. L. Markley, J. of the Astronautical Sciences 36, 1988).

    Args:
        start: (3,) of the cursor, axes of the base, m.
        along_x: (3,) after a movement from there along x of the world.
        along_y: (3,) after one along y, from the start as well.

    Raises:
        InvalidInputError: a movement that is too short, or two that are far from a right angle.
    """
    ways = [np.asarray(end) - start for end in (along_x, along_y)]
    for name, way in zip("xy", ways, strict=True):
        length = float(np.linalg.norm(way))
        if not length >= SHORTEST:
            rule = f"must be {SHORTEST:g} m or more"
            raise InvalidInputError(f"movement along {name}", f"{length:.4f} m", rule)
    directions = [way / np.linalg.norm(way) for way in ways]
    skew = float(np.arccos(np.clip(directions[0] @ directions[1], -1.0, 1.0)) - 0.5 * np.pi)
    if abs(skew) > SKEWEST:
        rule = f"must be 90° within {np.rad2deg(SKEWEST):.0f}°"
        raise InvalidInputError("angle of the movements", f"{np.rad2deg(skew) + 90.0:.0f}°", rule)
    rotation, _ = Rotation.align_vectors(np.eye(3)[:2], directions)
    return Mounting(rotation.as_matrix(), skew)


def reach_of(path: Array) -> tuple[Array, float]:
    """Return the middle (3,) of where a cursor was, m, and the largest ball there, its radius, m.

    The ball is that of the box of the path, whose sides are parallel to the base's axes.

    Args:
        path: (n, 3) of the cursor, m.
    """
    low, high = path.min(axis=0), path.max(axis=0)
    return 0.5 * (low + high), float(0.5 * (high - low).min())


# s until the service has answered; and between two looks.
PATIENCE, _ROUND = 5.0, 0.002


class CursorReader:
    """Reads the cursor for as long as it is asked to.

    Args:
        uri: of the service.
        device_id: of the Inverse3; empty: the only one there is.

    Raises:
        LinkError: the service does not answer, or has no such device.
        InvalidInputError: a frame that breaks a rule.

    Attributes:
        device_id: of the Inverse3 that was found.
        known: its configuration, from the service.
    """

    def __init__(self, uri: str, device_id: str = "") -> None:
        self._link = Link(uri)
        with ExitStack() as stack:
            stack.callback(self.close)
            found = found_in(parsed(self._first()), device_id)
            if found is None:
                raise LinkError(f"{uri}: the service has no Inverse3 {device_id}".rstrip())
            self.device_id, self.known = found.device_id, found.known
            self._link.send(greeting(self.device_id))
            self._answer()
            stack.pop_all()

    def path(self, seconds: float) -> Array:
        """Return where the cursor is for a while, (n, 3), axes of the base, m."""
        end, found = time.monotonic() + seconds, list[Array]()
        while time.monotonic() < end:
            found.append(self._read().position)
            time.sleep(_ROUND)
        return np.array(found)

    def mean(self, seconds: float) -> Array:
        """Return the mean of where the cursor is for a while, (3,)."""
        return np.asarray(self.path(seconds).mean(axis=0))

    def close(self) -> None:
        """End the connection."""
        self._link.close()

    def _read(self) -> Cursor:
        self._link.send(force_command(self.device_id, (0.0, 0.0, 0.0)))
        cursor = cursor_of(parsed(self._answer()), self.device_id)
        if cursor is None:
            raise InvalidInputError("frame", self.device_id, "must have the device")
        return cursor

    def _first(self) -> str:
        """Return the service's first report."""
        end = time.monotonic() + PATIENCE
        while not self._link.is_open:
            if time.monotonic() > end:
                raise LinkError(self._link.problem)
            self._link.look()
            time.sleep(_ROUND)
        return self._answer()

    def _answer(self) -> str:
        frames = self._link.answers(PATIENCE)
        if not frames:
            raise HapticMechError(self._link.problem or "the service does not answer")
        return frames[-1]
