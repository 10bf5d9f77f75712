"""Rotations as quaternions, in a way that leaves nothing behind."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from hapticmech_ros.arrays import Array

_ORIGIN = np.zeros(3)


def quaternion_of(rotation: Array) -> Array:
    """Return (4,) x, y, z, w of a rotation (3, 3).

    The bits of ``pin.Quaternion(rotation).coeffs()``, which never frees 80 bytes of each one made
    from a matrix (Pinocchio 4.1).

    Args:
        rotation: (3, 3) orthogonal, determinant 1.
    """
    return np.asarray(pin.SE3ToXYZQUAT(pin.SE3(rotation, _ORIGIN)))[3:]
