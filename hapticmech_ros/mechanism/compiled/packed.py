"""What kernels know of a configuration, as one array: see :class:`Packed`."""

from __future__ import annotations

from typing import NamedTuple

from hapticmech_ros.compilation import inner
from hapticmech_ros.mechanism.model import Array

# Length of a packed array's tail, and places in it from its end.
TAIL = 4
ERROR, RANK, LEAST, RESOLVED_RANK = -4, -3, -2, -1


class Packed(NamedTuple):
    """A configuration's terms; k = min(m, nv), and of k directions the first ``rank`` are filled.

    Attributes:
        factor: (nv, nv) lower Cholesky factor L of D.
        residual: (m,) φ.
        jacobian: (m, nv) W.
        basis: (k, nv) Uᵀ.
        sigma: (k,) σ.
        rows: (k, m) (V / row length)ᵀ.
        joint_jacobian: (nv, 6) columns of all joints, world axes, at the world's origin.
        poses: (frames, 12) each frame's axes in the world, then its origin.
        tail: (4,) largest |φ|, the rank, and ``least`` and ``resolved`` of a ConstraintSpace.
    """

    factor: Array
    residual: Array
    jacobian: Array
    basis: Array
    sigma: Array
    rows: Array
    joint_jacobian: Array
    poses: Array
    tail: Array


def packed_size(nv: int, m: int, frames: int) -> int:
    """Return the length of a packed array."""
    return nv * nv + m * (nv + 1) + min(m, nv) * (nv + m + 1) + 6 * nv + 12 * frames + TAIL


def views_of(packed: Array, nv: int, m: int) -> Packed:
    """Return the parts of a packed array, as views."""
    k = min(m, nv)
    at = nv * nv
    factor = packed[:at].reshape(nv, nv)
    residual = packed[at : at + m]
    at += m
    jacobian = packed[at : at + m * nv].reshape(m, nv)
    at += m * nv
    basis = packed[at : at + k * nv].reshape(k, nv)
    at += k * nv
    sigma = packed[at : at + k]
    at += k
    rows = packed[at : at + k * m].reshape(k, m)
    at += k * m
    joint_jacobian = packed[at : at + 6 * nv].reshape(nv, 6)
    at += 6 * nv
    last = packed.size - TAIL
    poses = packed[at:last].reshape((last - at) // 12, 12)
    return Packed(
        factor, residual, jacobian, basis, sigma, rows, joint_jacobian, poses, packed[last:]
    )


unpack = inner(views_of)
