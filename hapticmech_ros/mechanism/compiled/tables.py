"""What kernels know of a mechanism: its constants for one set of active closures, in two arrays.

A call of a kernel pays for each of its arrays, so that few long ones take the place of many. The
arrays begin with sizes; :func:`unfold` finds the tables again, at no cost, inside kernels.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from hapticmech_ros.compilation import inner
from hapticmech_ros.mechanism.model import Array

_SIZES = 9


class Tables(NamedTuple):
    """Constants of a mechanism with a set of active closures; f frames, j joints.

    Attributes:
        nq: length of q.
        nv: number of rates.
        m: number of closure rows.
        carriers: (f,) joint that carries each frame.
        joints: (j, 3) per joint its parent, its first rate and its number of rates; 0 is the world.
        closures: (closures, 4) kind, frames a and b, and first row.
        points: (points,) frame of each operational point.
        damping: (nv,) viscous damping, N m s/rad or N s/m.
        lengths: (m,) unit of each row, m or 1.
        support: (f, nv) 1 where a rate moves a frame, else 0.
        placements: (f, 12) each frame in its joint: its axes, then its origin, m. Of a rod's frame
            a the first axis is as long as the rod.
        elements: (e, 2) per joint with spring, friction or stops its index in v and in q.
        springs: (s, 2) frames a and b of each spring between points.
        effort: (nv,) constant forces of the joints, N m or N.
        element_values: (e, 9) stiffness, rest, friction and its speed, lower and upper stop, their
            stiffness, damping and depth.
        spring_values: (s, 4) stiffness, damping, rest length, and length without direction.
    """

    nq: int
    nv: int
    m: int
    carriers: Array
    joints: Array
    closures: Array
    points: Array
    damping: Array
    lengths: Array
    support: Array
    placements: Array
    elements: Array
    springs: Array
    effort: Array
    element_values: Array
    spring_values: Array


def fold(tables: Tables) -> tuple[Array, Array]:
    """Return the tables as an array of integers and an array of floats."""
    sizes = np.array(
        (
            tables.nq,
            tables.nv,
            tables.m,
            tables.carriers.size,
            len(tables.joints),
            len(tables.closures),
            tables.points.size,
            len(tables.elements),
            len(tables.springs),
        )
    )
    whole = (
        sizes,
        tables.carriers,
        tables.joints,
        tables.closures,
        tables.points,
        tables.elements,
        tables.springs,
    )
    real = (
        tables.damping,
        tables.lengths,
        tables.support,
        tables.placements,
        tables.effort,
        tables.element_values,
        tables.spring_values,
    )
    return (
        np.concatenate([part.ravel() for part in whole]).astype(np.int64),
        np.concatenate([part.ravel() for part in real]).astype(float),
    )


@inner
def unfold(numbers: Array, values: Array) -> Tables:
    """Return the tables as views of what :func:`fold` made."""
    nq, nv, m = numbers[0], numbers[1], numbers[2]
    frames, joints, closures, points = numbers[3], numbers[4], numbers[5], numbers[6]
    at = _SIZES
    carriers = numbers[at : at + frames]
    at += frames
    tree = numbers[at : at + 3 * joints].reshape(joints, 3)
    at += 3 * joints
    loops = numbers[at : at + 4 * closures].reshape(closures, 4)
    at += 4 * closures
    held = numbers[at : at + points]
    at += points
    count, springs = numbers[7], numbers[8]
    elements = numbers[at : at + 2 * count].reshape(count, 2)
    at += 2 * count
    pulls = numbers[at : at + 2 * springs].reshape(springs, 2)
    start, end = nv + m, nv + m + frames * nv
    support = values[start:end].reshape(frames, nv)
    placements = values[end : end + 12 * frames].reshape(frames, 12)
    start = end + 12 * frames
    end = start + nv
    effort = values[start:end]
    element_values = values[end : end + 9 * count].reshape(count, 9)
    end += 9 * count
    return Tables(
        nq,
        nv,
        m,
        carriers,
        tree,
        loops,
        held,
        values[:nv],
        values[nv : nv + m],
        support,
        placements,
        elements,
        pulls,
        effort,
        element_values,
        values[end : end + 4 * springs].reshape(springs, 4),
    )
