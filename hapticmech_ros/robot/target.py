# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What a robot is to do at its operational point: a motion, and along one direction a force."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, fields

import numpy as np
import pinocchio as pin

from hapticmech_ros.arrays import Array
from hapticmech_ros.errors import InvalidInputError

# Beyond this a rate, 1/s, is no gain that a loop in discrete time can have.
_LARGEST = 1e4


@dataclass(frozen=True, slots=True)
class Gains:
    """Gains of the law, checked when they are made.

    An error of position e obeys ë + 2 ζ ω ė + ω² e = 0 where the law decouples; so does the posture
    in the null space.

    Attributes:
        linear_rate: ω of the point's position, 1/s.
        angular_rate: ω of its orientation, 1/s.
        damping_ratio: ζ of both, and of the posture.
        posture_rate: ω with which joints return to their posture in the null space, 1/s.
        posture_acceleration: most that the posture asks for, of each joint, rad/s² or m/s².
        joint_rate: with which joints are led at most along a direction in which they have an error,
            or which is rigid, rad/s or m/s.
        rest_rate: rate at which motion of the null space decays, 1/s.
        force_rate: rate at which the integral of a force's error grows, 1/s.
        contact_rate: rate at which motion along a controlled force decays, 1/s.
        contact_share: c of R4, 0 to 1: share of the measured contact wrench beside a controlled
            force that is balanced; with 1 friction disturbs neither the force nor the motion.

    Raises:
        InvalidInputError: one is negative, not finite or above 1e4, or a share above 1.
    """

    linear_rate: float = 30.0
    angular_rate: float = 30.0
    damping_ratio: float = 1.0
    posture_rate: float = 5.0
    posture_acceleration: float = 5.0
    joint_rate: float = 3.0
    rest_rate: float = 30.0
    force_rate: float = 5.0
    contact_rate: float = 60.0
    contact_share: float = 1.0

    def __post_init__(self) -> None:
        for gain in fields(self):
            value = getattr(self, gain.name)
            if not (math.isfinite(value) and 0.0 <= value <= _LARGEST):
                rule = f"must be a number between 0 and {_LARGEST:g}"
                raise InvalidInputError(gain.name, value, rule)
        if self.joint_rate == 0.0:
            raise InvalidInputError("joint_rate", 0.0, "must be above 0")
        if self.contact_share > 1.0:
            raise InvalidInputError("contact_share", self.contact_share, "must be at most 1")


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
