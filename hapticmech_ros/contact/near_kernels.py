"""Broad phase: where all shapes are, and which declared pairs are near enough to touch in a step.

Bounding boxes along the world's axes, widened by how far a shape can come in the time ahead.
"""

from __future__ import annotations

import numpy as np

from hapticmech_ros.arrays import Array
from hapticmech_ros.compilation import inner, kernel, local, shaped
from hapticmech_ros.contact.shape_kernels import (
    HALF_SIZE,
    HALF_SPACE,
    JOINT,
    KIND,
    MIDDLE,
    compose,
    put_point,
)

# Half-lengths of the bounding box, its middle, and how far the shape can come: m.
BOX_VALUES = 7


@inner
def _bound(
    values: Array,
    pose: Array,
    axes: Array,
    moves: Array,
    rates: Array,
    span: float,
    slack: float,
    box: Array,
) -> None:
    """Fill a shape's bounding box and how far it can come."""
    put_point(pose, values[MIDDLE], values[MIDDLE + 1], values[MIDDLE + 2], box[3:6])
    size = 0.0
    for i in range(3):
        box[i] = 0.0
        for axis in range(3):
            box[i] += abs(pose[3 * axis + i]) * values[HALF_SIZE + axis]
        size += values[HALF_SIZE + i]
    twist = local(6)
    twist[:] = 0.0
    for rate in range(rates.size):
        if moves[rate] != 0.0:
            for i in range(6):
                twist[i] += axes[rate, i] * rates[rate]
    x, y, z = box[3], box[4], box[5]
    across = (
        twist[0] + twist[4] * z - twist[5] * y,
        twist[1] + twist[5] * x - twist[3] * z,
        twist[2] + twist[3] * y - twist[4] * x,
    )
    speed = np.sqrt(across[0] ** 2 + across[1] ** 2 + across[2] ** 2)
    turning = np.sqrt(twist[3] ** 2 + twist[4] ** 2 + twist[5] ** 2)
    box[6] = span * (speed + turning * size) + slack * size


@inner
def _height(plane: Array, box: Array) -> float:
    """Return how far a bounding box stays above a plane, m."""
    height = 0.0
    for i in range(3):
        height += plane[6 + i] * (box[3 + i] - plane[9 + i]) - abs(plane[6 + i]) * box[i]
    return float(height)


@kernel(
    "i8(i8[:, ::1], f8[:, ::1], f8[:, ::1], f8[:, ::1], f8[:, ::1], f8[::1], f8, f8,"
    " i8[:, ::1], f8[:, ::1], f8[::1])"
)
def near_pairs(
    numbers: Array,
    values: Array,
    joint_poses: Array,
    axes: Array,
    moves: Array,
    rates: Array,
    span: float,
    slack: float,
    pairs: Array,
    poses: Array,
    margins: Array,
) -> int:
    """Fill ``poses`` and ``margins``, and return how many pairs are near.

    Args:
        numbers: (shapes, 6) of the shapes; see ``ShapeTables``.
        values: (shapes, 20).
        joint_poses: (joints, 12) in the world.
        axes: (nv, 6) joint axes, as twists about the world's origin.
        moves: (joints, nv) 1 where a rate moves a joint, 0 elsewhere.
        rates: (nv,) expected.
        span: s ahead.
        slack: share of a shape's size by which it may be apart, moving or not.
        pairs: (pairs, 4) indices of shapes a and b, and what is not looked at here.
        poses: (shapes, 12) to fill, in the world.
        margins: (pairs,) to fill, m: gap up to which points of a pair count; -1 if it is far.
    """
    boxes = shaped(local(numbers.shape[0] * BOX_VALUES), (numbers.shape[0], BOX_VALUES))
    for shape in range(numbers.shape[0]):
        joint = numbers[shape, JOINT]
        compose(joint_poses[joint], values[shape, :12], poses[shape])
        _bound(values[shape], poses[shape], axes, moves[joint], rates, span, slack, boxes[shape])
    count = 0
    for pair in range(pairs.shape[0]):
        a, b = pairs[pair, 0], pairs[pair, 1]
        margin = boxes[a, 6] + boxes[b, 6]
        if numbers[a, KIND] == HALF_SPACE:
            near = _height(poses[a], boxes[b]) <= margin
        elif numbers[b, KIND] == HALF_SPACE:
            near = _height(poses[b], boxes[a]) <= margin
        else:
            near = True
            for i in range(3):
                gap = abs(boxes[a, 3 + i] - boxes[b, 3 + i]) - boxes[a, i] - boxes[b, i]
                near = near and gap <= margin
        margins[pair] = margin if near else -1.0
        count += 1 if near else 0
    return count
