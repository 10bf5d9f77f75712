# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Rotations: as quaternions, in a way that leaves nothing behind, and of wrenches and twists."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from hapticmech_ros.numerics import Array

_ORIGIN = np.zeros(3)


def quaternion_of(rotation: Array) -> Array:
    """Return (4,) x, y, z, w of a rotation (3, 3).

    The bits of ``pin.Quaternion(rotation).coeffs()``, which never frees 80 bytes of each one made
    from a matrix (Pinocchio 4.1).

    Args:
        rotation: (3, 3) orthogonal, determinant 1.
    """
    return np.asarray(pin.SE3ToXYZQUAT(pin.SE3(rotation, _ORIGIN)))[3:]


def turned(six: Array, rotation: Array) -> Array:
    """Return a wrench or twist (6,) in other axes, about the same point.

    Args:
        six: (6,) N and N m, or m/s and rad/s, or m and rad.
        rotation: (3, 3) its axes in those that are wanted.
    """
    return np.concatenate((rotation @ six[:3], rotation @ six[3:]))


def place_of(numbers: Array) -> pin.SE3:
    """Return the pose of a position, m, and a quaternion of any length but 0, (7,) in all.

    Args:
        numbers: (7,) position, m, and quaternion x, y, z, w.
    """
    quaternion = numbers[3:]
    length = float(np.sqrt(quaternion @ quaternion))
    return pin.SE3(pin.Quaternion(quaternion / length).matrix(), numbers[:3])
