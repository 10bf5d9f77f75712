# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What kernels know of a mechanism: its constants for one set of active closures, in two arrays.

A call of a kernel pays for each of its arrays, so that few long ones take the place of many. The
whole numbers begin with sizes, and with where each part is; the others end with a workspace,
since to allocate a dozen numbers takes longer than to compute them.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from hapticmech_ros.arrays import Array
from hapticmech_ros.compilation import SIZES, Part, Size, Structure, structure
from hapticmech_ros.mechanism.kernels.many_rows import SOME_ROWS
from hapticmech_ros.mechanism.kernels.step_layout import STEP_ACCOUNT, STEP_SETTINGS, TERMS_TAIL

# Path of a factorisation: see ``data.Data``.
DENSE, SPARSE = 0, 1
JOINT_COLUMNS, JOINT_NUMBERS, FRAME_COLUMNS = 57, 5, 12
# Stages of a step, at most.
MOST_STAGES = 6
# What a sparse factorisation keeps of a rate, and of a closure row beside its band.
_PIVOT, _ROW = 8, 5


class Constants(NamedTuple):
    """Constants of a mechanism with a set of active closures; f frames, j joints with the world.

    Only frames are there that closures, operational points and springs need.

    Attributes:
        nq: length of q.
        nv: number of rates.
        m: number of closure rows.
        path: DENSE or SPARSE.
        width: of a sparse factorisation's band; 0 of a dense one.
        border: number of rates that are in no band, the last ones in ``order``; see
            ``band_kernels``.
        independent: rank that a sparse factorisation has to have, -1 for any.
        carriers: (f,) joint that carries each frame.
        joints: (j, 5) per joint its parent, its first rate, its number of rates, its kind (see
            ``tree_kernels``) and where it is in q; 0 is the world.
        closures: (closures, 4) kind, frames a and b, and first row.
        points: (points,) frame of each operational point.
        elements: (e, 2) per joint with spring, friction or stops its index in v and in q.
        springs: (s, 2) frames a and b of each spring between points.
        order: (nv,) a sparse factorisation's order of rates; (0,) of a dense one.
        sequence: (m, 5) its order of closure rows: row, first and last place in ``order`` that it
            reaches before the border, joints a and b; (0, 5) of a dense one.
        damping: (nv,) viscous damping, N m s/rad or N s/m.
        lengths: (m,) length of each row in m, 1 for rows in rad: what residuals are compared with.
        units: (m,) what each row of W is divided by before it is factored; see
            :meth:`~hapticmech_ros.mechanism.mechanism.MultibodyModel.row_units`.
        rounding: (1,) σ of rows over their units below which all is rounding.
        placements: (f, 12) each frame in its joint: its axes, then its origin, m. Of a rod's frame
            a the first axis is as long as the rod.
        effort: (nv,) constant forces of the joints, N m or N.
        element_values: (e, 9) stiffness, rest, friction and its speed, lower and upper stop, their
            stiffness, damping and depth.
        spring_values: (s, 4) stiffness, damping, rest length, and length without direction.
        joint_values: (j, 57) see ``tree_kernels.joint_row``.
        gravity: (3,) m/s².
    """

    nq: int
    nv: int
    m: int
    path: int
    width: int
    border: int
    independent: int
    carriers: Array
    joints: Array
    closures: Array
    points: Array
    elements: Array
    springs: Array
    order: Array
    sequence: Array
    damping: Array
    lengths: Array
    units: Array
    rounding: Array
    placements: Array
    effort: Array
    element_values: Array
    spring_values: Array
    joint_values: Array
    gravity: Array


# Which parts are where: their number in the table of places, behind the sizes.
_WHOLE = ("carriers", "joints", "closures", "points", "elements", "springs", "order", "sequence")
_REAL = (
    "damping",
    "lengths",
    "placements",
    "effort",
    "element_values",
    "spring_values",
    "joint_values",
    "gravity",
)
_COLUMNS = {
    "joints": JOINT_NUMBERS,
    "closures": 4,
    "elements": 2,
    "springs": 2,
    "sequence": 5,
    "placements": FRAME_COLUMNS,
    "element_values": 9,
    "spring_values": 4,
    "joint_values": JOINT_COLUMNS,
}
_PARTS = 65
# Rows of ``Model.small``.
_SMALL = 4


def pack(constants: Constants) -> tuple[Array, Array]:
    """Return constants as (integers,) and (numbers,); see :class:`Model`."""
    whole = [np.asarray(getattr(constants, name), dtype=np.int64) for name in _WHOLE]
    real = [np.asarray(getattr(constants, name), dtype=float) for name in _REAL]
    places = _places(_WHOLE, whole, SIZES + 3 * _PARTS)
    places += _places(_REAL, real, 0)
    of_data, size = _data_places(constants)
    places += of_data + _work_places(constants)
    rooms, workspace = _stacked(_workspace_shapes(constants), sum(part.size for part in real))
    places += rooms
    constant = np.concatenate([*(part.ravel() for part in real), np.zeros(workspace)])
    places += [constant.size, constants.m, 1, constant.size + constants.m, 1, 1]
    sizes = (*constants[:7], size)
    return (
        np.concatenate([np.array((*sizes, *places)), *(part.ravel() for part in whole)]),
        np.concatenate((constant, constants.units, constants.rounding)),
    )


def _places(names: Sequence[str], parts: Sequence[Array], start: int) -> list[int]:
    """Return start, rows and columns of parts that follow each other."""
    places = []
    for name, part in zip(names, parts, strict=True):
        columns = _COLUMNS.get(name, 1)
        places += [start, part.size // columns, columns]
        start += part.size
    return places


def _data_places(constants: Constants) -> tuple[list[int], int]:
    """Return start, rows and columns of a packed array's parts, and its length."""
    nv, m = constants.nv, constants.m
    frames, joints = len(constants.carriers), len(constants.joints)
    dense = constants.path == DENSE
    # Of the two kinds one has its sizes, the other none.
    n, rows, k = (nv, m, min(m, nv)) if dense else (0, 0, 0)
    pivots, band = (0, 0) if dense else (nv, m)
    shapes = [(m, 1), (m, 12), (nv, 6), (frames, 12), (joints, 12), (joints, 12)]
    shapes += [(n, n), (rows, n), (k, n), (k, 1), (k, rows)]
    shapes += [(pivots, _PIVOT), (band, constants.width), (band, _ROW)]
    border = constants.border
    shapes += [(m + border if border else 0, border), (TERMS_TAIL.size, 1)]
    return _stacked(shapes)


def _work_places(constants: Constants) -> list[int]:
    """Return start, rows and columns of the parts of a step's work; see ``step_kernels.Work``."""
    nq, nv = constants.nq, constants.nv
    shapes = [(STEP_SETTINGS.size, 1), (MOST_STAGES, 2), (STEP_ACCOUNT.size, 1)]
    shapes += [(nq, 1), (nv, 1), (nq, 1), (nv, 1)]
    places, _ = _stacked([*shapes, *[(nv, 1)] * 5, (len(constants.points), 6)])
    # q and v, one after the other, are the state as well.
    return [*places, places[15], nq + nv, 1]


def _workspace_shapes(constants: Constants) -> list[tuple[int, int]]:
    """Return rows and columns of the parts to work in; see :class:`Model`."""
    nv, m, joints = constants.nv, constants.m, len(constants.joints)
    shapes = [(joints, 36), (joints, 12), (3, nv), (m, 1), (nv + m, 1), (nv, 1), (m, 1)]
    shapes += [(m if constants.border else 0, 1)]
    of_dense = m if constants.path == DENSE else 0
    many, most = (m, min(m, nv)) if of_dense >= SOME_ROWS else (0, 0)
    shapes += [(of_dense, nv), (of_dense, of_dense), (_SMALL, FRAME_COLUMNS)]
    shapes += [(nv if many else 0, many), (most, nv), (nv if many else 0, most), (most, many)]
    return [*shapes, (3, most * many), (2, max(many, nv) if many else 0)]


def _stacked(shapes: Sequence[tuple[int, int]], start: int = 0) -> tuple[list[int], int]:
    """Return start, rows and columns of parts that follow each other, and their length."""
    places, length = [], 0
    for height, columns in shapes:
        places += [start + length, height, columns]
        length += height * columns
    return places, length


@structure
class Model(Structure):
    """:class:`Constants`, packed: each part a view, found when it is asked for.

    What follows the constants is a workspace. No function finds it as it left it; none writes to
    what its caller still needs.

    Attributes:
        sweep: (joints, 36) what is carried from joint to joint.
        motions: (joints, 12) the joints' motions; see ``motion_kernels.move_joints``.
        forces: (3, nv) h, forces of elements, and their dissipative part.
        bias: (m,) Ẇv.
        result: (nv + m,) v̇ and λ.
        turned: (nv,) a vector by places, of one function at a time.
        along: (m,) numbers along the closures' directions, likewise.
        across: (m,) numbers at the pivots of a sparse factorisation with a border; else (0,).
        scaled: (m, nv) rows to be made orthogonal; dense.
        turn: (m, m) what that takes; dense.
        small: (4, 12) rows for a frame, a pair of wrenches, or less.
        columns: (nv, m) closure rows as columns, to be made triangular; dense, of some rows.
        reflectors: (k, nv) what that takes; likewise, as what follows.
        directions: (nv, k) columns of Q.
        inverse: (k, m) (Rᵀ)⁺.
        inverting: (3, k m) what that takes.
        sums: (2, max(m, nv)) numbers along columns.
    """

    __slots__ = ()

    nq = Size(0)
    nv = Size(1)
    m = Size(2)
    path = Size(3)
    width = Size(4)
    border = Size(5)
    independent = Size(6)
    carriers = Part(0, 1, whole=True)
    joints = Part(1, 2, whole=True)
    closures = Part(2, 2, whole=True)
    points = Part(3, 1, whole=True)
    elements = Part(4, 2, whole=True)
    springs = Part(5, 2, whole=True)
    order = Part(6, 1, whole=True)
    sequence = Part(7, 2, whole=True)
    damping = Part(8, 1)
    lengths = Part(9, 1)
    placements = Part(10, 2)
    effort = Part(11, 1)
    element_values = Part(12, 2)
    spring_values = Part(13, 2)
    joint_values = Part(14, 2)
    gravity = Part(15, 1)
    sweep = Part(46, 2)
    motions = Part(47, 2)
    forces = Part(48, 2)
    bias = Part(49, 1)
    result = Part(50, 1)
    turned = Part(51, 1)
    along = Part(52, 1)
    across = Part(53, 1)
    scaled = Part(54, 2)
    turn = Part(55, 2)
    small = Part(56, 2)
    columns = Part(57, 2)
    reflectors = Part(58, 2)
    directions = Part(59, 2)
    inverse = Part(60, 2)
    inverting = Part(61, 2)
    sums = Part(62, 2)
    units = Part(63, 1)
    rounding = Part(64, 1)
