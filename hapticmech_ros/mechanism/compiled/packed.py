"""What kernels know of a configuration, as one array: see :class:`Packed`."""

from __future__ import annotations

from typing import NamedTuple

from hapticmech_ros.compilation import inner
from hapticmech_ros.mechanism.compiled.tables import DENSE, Tables
from hapticmech_ros.mechanism.model import Array

# Length of a packed array's tail, and places in it from its end.
TAIL = 4
ERROR, RANK, LEAST, RESOLVED_RANK = -4, -3, -2, -1
# Numbers that a sparse factorisation keeps of a rate, and of a closure row beside its band.
_HINGE, _ROW = 7, 5


class Packed(NamedTuple):
    """A configuration's terms; k = min(m, nv), and of k directions the first ``rank`` are filled.

    Dense and sparse factorisations share the array's second half; what the other one has is empty.

    Attributes:
        residual: (m,) φ.
        wrenches: (m, 12) W row by row: the wrenches on the joints of frames a and b whose power is
            the row's rate, force first, moment about the world's origin.
        joint_jacobian: (nv, 6) columns of all joints, world axes, at the world's origin.
        poses: (frames, 12) each frame's axes in the world, then its origin.
        places: (joints, 12) the joints' own poses.
        bodies: (joints, 12) each joint's own inertia in world axes about the world's origin: mass,
            mass times centre, and xx, xy, xz, yy, yz, zz.
        factor: (nv, nv) lower Cholesky factor L of D; dense.
        jacobian: (m, nv) W; dense.
        basis: (k, nv) Uᵀ; dense.
        sigma: (k,) σ; dense.
        rows: (k, m) (V / row length)ᵀ; dense.
        hinges: (nv, 7) articulated inertia times each axis, and the root of its pivot; sparse.
        band: (m, width) rows of R over reflectors, by ``sequence``; sparse.
        row_places: (m, 5) per closure row where its band begins, its pivot or -1, R's diagonal, the
            band's last row, and the first row before it that reaches into it; sparse.
        tail: (4,) largest |φ|, the rank, and ``least`` and ``resolved`` of a ConstraintSpace.
    """

    residual: Array
    wrenches: Array
    joint_jacobian: Array
    poses: Array
    places: Array
    bodies: Array
    factor: Array
    jacobian: Array
    basis: Array
    sigma: Array
    rows: Array
    hinges: Array
    band: Array
    row_places: Array
    tail: Array


def packed_size(tables: Tables) -> int:
    """Return the length of a packed array."""
    nv, m = tables.nv, tables.m
    size = 13 * m + 6 * nv + 12 * (len(tables.carriers) + 2 * len(tables.joints)) + TAIL
    if tables.path == DENSE:
        return int(size + nv * nv + m * nv + min(m, nv) * (nv + m + 1))
    return int(size + _HINGE * nv + m * (tables.width + _ROW))


def views_of(packed: Array, tables: Tables) -> Packed:
    """Return the parts of a packed array, as views."""
    nv, m, dense = tables.nv, tables.m, tables.path == DENSE
    frames, joints = tables.carriers.size, tables.joints.shape[0]
    residual = packed[:m]
    at = 13 * m
    wrenches = packed[m:at].reshape(m, 12)
    joint_jacobian = packed[at : at + 6 * nv].reshape(nv, 6)
    at += 6 * nv
    poses = packed[at : at + 12 * frames].reshape(frames, 12)
    at += 12 * frames
    places = packed[at : at + 12 * joints].reshape(joints, 12)
    at += 12 * joints
    bodies = packed[at : at + 12 * joints].reshape(joints, 12)
    at += 12 * joints
    # Of the two kinds one has its sizes, the other none.
    n, rows, k = (nv, m, min(m, nv)) if dense else (0, 0, 0)
    factor = packed[at : at + n * n].reshape(n, n)
    at += n * n
    jacobian = packed[at : at + rows * n].reshape(rows, n)
    at += rows * n
    basis = packed[at : at + k * n].reshape(k, n)
    at += k * n
    sigma = packed[at : at + k]
    at += k
    maps = packed[at : at + k * rows].reshape(k, rows)
    at += k * rows
    n, rows = (0, 0) if dense else (nv, m)
    hinges = packed[at : at + _HINGE * n].reshape(n, _HINGE)
    at += _HINGE * n
    band = packed[at : at + rows * tables.width].reshape(rows, tables.width)
    at += rows * tables.width
    row_places = packed[at : at + _ROW * rows].reshape(rows, _ROW)
    return Packed(
        residual,
        wrenches,
        joint_jacobian,
        poses,
        places,
        bodies,
        factor,
        jacobian,
        basis,
        sigma,
        maps,
        hinges,
        band,
        row_places,
        packed[packed.size - TAIL :],
    )


unpack = inner(views_of)
