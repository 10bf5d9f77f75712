"""What kernels know of a mechanism: its constants for one set of active closures, in two arrays.

A call of a kernel pays for each of its arrays, so that few long ones take the place of many. The
arrays begin with sizes; :func:`unfold` finds the tables again, at no cost, inside kernels.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from hapticmech_ros.compilation import inner
from hapticmech_ros.mechanism.model import Array

# Path of a factorisation: see ``packed.Packed``.
DENSE, SPARSE = 0, 1
JOINT_COLUMNS, JOINT_NUMBERS, FRAME_COLUMNS = 52, 5, 12
_SIZES = 11


class Tables(NamedTuple):
    """Constants of a mechanism with a set of active closures; f frames, j joints with the world.

    Only frames are there that closures, operational points and springs need.

    Attributes:
        nq: length of q.
        nv: number of rates.
        m: number of closure rows.
        path: DENSE or SPARSE.
        width: of a sparse factorisation's band; 0 of a dense one.
        carriers: (f,) joint that carries each frame.
        joints: (j, 5) per joint its parent, its first rate, its number of rates, its kind (see
            ``tree_kernels``) and where it is in q; 0 is the world.
        closures: (closures, 4) kind, frames a and b, and first row.
        points: (points,) frame of each operational point.
        elements: (e, 2) per joint with spring, friction or stops its index in v and in q.
        springs: (s, 2) frames a and b of each spring between points.
        order: (nv,) a sparse factorisation's order of rates; (0,) of a dense one.
        sequence: (m, 5) its order of closure rows: row, first and last place in ``order`` that it
            reaches, joints a and b; (0, 5) of a dense one.
        damping: (nv,) viscous damping, N m s/rad or N s/m.
        lengths: (m,) unit of each row, m or 1.
        placements: (f, 12) each frame in its joint: its axes, then its origin, m. Of a rod's frame
            a the first axis is as long as the rod.
        effort: (nv,) constant forces of the joints, N m or N.
        element_values: (e, 9) stiffness, rest, friction and its speed, lower and upper stop, their
            stiffness, damping and depth.
        spring_values: (s, 4) stiffness, damping, rest length, and length without direction.
        joint_values: (j, 52) see ``tree_kernels.joint_row``.
        gravity: (3,) m/s².
    """

    nq: int
    nv: int
    m: int
    path: int
    width: int
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
    placements: Array
    effort: Array
    element_values: Array
    spring_values: Array
    joint_values: Array
    gravity: Array


def fold(tables: Tables) -> tuple[Array, Array]:
    """Return the tables as an array of integers and an array of floats."""
    counts = [len(part) for part in tables[5:11]]
    sizes = np.array((tables.nq, tables.nv, tables.m, tables.path, tables.width, *counts))
    return (
        np.concatenate([sizes, *(part.ravel() for part in tables[5:13])]).astype(np.int64),
        np.concatenate([part.ravel() for part in tables[13:]]).astype(float),
    )


@inner
def unfold(numbers: Array, values: Array) -> Tables:
    """Return the tables as views of what :func:`fold` made."""
    nq, nv, m, path, width = numbers[0], numbers[1], numbers[2], numbers[3], numbers[4]
    frames, joints, closures, points = numbers[5], numbers[6], numbers[7], numbers[8]
    count, springs = numbers[9], numbers[10]
    at = _SIZES
    carriers = numbers[at : at + frames]
    at += frames
    tree = numbers[at : at + JOINT_NUMBERS * joints].reshape(joints, JOINT_NUMBERS)
    at += JOINT_NUMBERS * joints
    loops = numbers[at : at + 4 * closures].reshape(closures, 4)
    at += 4 * closures
    held = numbers[at : at + points]
    at += points
    elements = numbers[at : at + 2 * count].reshape(count, 2)
    at += 2 * count
    pulls = numbers[at : at + 2 * springs].reshape(springs, 2)
    at += 2 * springs
    sparse = path != DENSE
    order = numbers[at : at + (nv if sparse else 0)]
    at += order.size
    sequence = numbers[at : at + (5 * m if sparse else 0)].reshape(m if sparse else 0, 5)
    damping, lengths = values[:nv], values[nv : nv + m]
    at = nv + m
    placements = values[at : at + FRAME_COLUMNS * frames].reshape(frames, FRAME_COLUMNS)
    at += FRAME_COLUMNS * frames
    effort = values[at : at + nv]
    at += nv
    element_values = values[at : at + 9 * count].reshape(count, 9)
    at += 9 * count
    spring_values = values[at : at + 4 * springs].reshape(springs, 4)
    at += 4 * springs
    end = at + JOINT_COLUMNS * joints
    joint_values = values[at:end].reshape(joints, JOINT_COLUMNS)
    return Tables(
        nq,
        nv,
        m,
        path,
        width,
        carriers,
        tree,
        loops,
        held,
        elements,
        pulls,
        order,
        sequence,
        damping,
        lengths,
        placements,
        effort,
        element_values,
        spring_values,
        joint_values,
        values[end : end + 3],
    )
