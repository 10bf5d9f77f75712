# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What kernels know of a configuration, as one array: see :class:`Data`."""

from __future__ import annotations

from hapticmech_ros.arrays import Array
from hapticmech_ros.compilation import Part, Structure, inner, structure
from hapticmech_ros.mechanism.kernels.model import Model


@structure
class Data(Structure):
    """A configuration's terms; k = min(m, nv), and of k directions the first ``rank`` are filled.

    Dense and sparse factorisations share the array's first half; what the other one has is empty.

    Attributes:
        residual: (m,) φ.
        pairs: (m, 12) W row by row: the wrenches on the joints of frames a and b whose power is the
            row's rate, force first, moment about the world's origin.
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
        pivots: (nv, 8) articulated inertia times each axis over the root of its pivot, that root,
            and its inverse; sparse.
        band: (m, width) rows of R over reflectors, by ``sequence``; sparse.
        row_places: (m, 5) per closure row where its band begins, its pivot or -1, the inverse of
            R's diagonal, the band's last row, and the first row before it that reaches into it;
            sparse.
        shares: (m + border, border) what is free of the rows' pivots, by ``sequence``, and of the
            border's rates: columns that are orthonormal; sparse.
        tail: (5,) the array's end, see ``step_layout.TERMS_TAIL``.
    """

    __slots__ = ()

    residual = Part(16, 1)
    pairs = Part(17, 2)
    joint_jacobian = Part(18, 2)
    poses = Part(19, 2)
    places = Part(20, 2)
    bodies = Part(21, 2)
    factor = Part(22, 2)
    jacobian = Part(23, 2)
    basis = Part(24, 2)
    sigma = Part(25, 1)
    rows = Part(26, 2)
    pivots = Part(27, 2)
    band = Part(28, 2)
    row_places = Part(29, 2)
    shares = Part(30, 2)
    tail = Part(31, 1)


# Their names.
PARTS = tuple(name for name, part in vars(Data).items() if isinstance(part, Part))


def data_size(model: Model) -> int:
    """Return the length of a packed array."""
    return int(model.numbers[7])


def views_of(packed: Array, model: Model) -> Data:
    """Return the parts of a packed array, as views.

    Args:
        packed: (size,) packed terms.
        model: the mechanism's.
    """
    return Data(model.numbers, packed)


unpack = inner(views_of)
