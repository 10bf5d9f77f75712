# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What a robot is to do at its operational point: a motion, and along one direction a force."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import pinocchio as pin

from hapticmech_ros.arrays import Array
from hapticmech_ros.errors import InvalidInputError

# How far from 1 the length of a direction may be: what is left of one written with six digits.
_UNIT = 1e-5


@dataclass(frozen=True, slots=True)
class ForceTask:
    """A force that is controlled along one direction, in place of the motion along it.

    Attributes:
        direction: (3,) unit vector n, world axes, along which the robot is to push.
        force: f_d that the robot is to exert along n, N.

    Raises:
        InvalidInputError: a direction that is no unit vector, or a force that is not finite.
    """

    direction: Array
    force: float

    def __post_init__(self) -> None:
        length = float(np.linalg.norm(self.direction))
        if np.shape(self.direction) != (3,) or not abs(length - 1.0) <= _UNIT:
            raise InvalidInputError("direction", self.direction, "must be a unit vector (3,)")
        if not np.isfinite(self.force):
            raise InvalidInputError("force", self.force, "must be finite")

    def without(self, six: Array) -> Array:
        """Return a vector (6,), linear before angular, without its part along n.

        Args:
            six: (6,) in world axes.
        """
        left = np.array(six, dtype=float)
        left[:3] -= float(self.direction @ left[:3]) * self.direction
        return left


def _nothing() -> Array:
    return np.zeros(6)


@dataclass(frozen=True, slots=True)
class Target:
    """Where the operational point is to be, and how it is to move.

    Attributes:
        pose: x_d, in the world of the robot's scene.
        twist: (6,) ẋ_d, m/s and rad/s, world axes, at the point.
        acceleration: (6,) ẍ_d, m/s² and rad/s², likewise.
        force: what is controlled instead of motion along one direction; None: nothing.
    """

    pose: pin.SE3
    twist: Array = field(default_factory=_nothing)
    acceleration: Array = field(default_factory=_nothing)
    force: ForceTask | None = None
