# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Broad phase: where all shapes are, and which declared pairs are near enough to touch in a step.

Bounding boxes along the world's axes, widened by how far a shape can come in the time ahead.
"""

from __future__ import annotations

import numpy as np

from hapticmech_ros.arrays import Array
from hapticmech_ros.compilation import inner, local
from hapticmech_ros.contact.layout import (
    HALF_SIZE,
    HALF_SPACE,
    JOINT,
    KIND,
    MIDDLE,
    NEEDS_SEARCH,
    SHAPE_A,
    SHAPE_B,
    Contacts,
)
from hapticmech_ros.contact.shape_kernels import compose, put_point
from hapticmech_ros.mechanism.kernels.data import Data


@inner
def place_shapes(contacts: Contacts, data: Data) -> None:
    """Fill ``axes`` and ``poses`` at the configuration that ``data`` was filled at."""
    axes, seen, values = contacts.axes, data.joint_jacobian, contacts.shape_values
    shapes, poses, places = contacts.shapes, contacts.poses, data.places
    for rate in range(axes.shape[0]):
        for i in range(6):
            axes[rate, i] = seen[rate, i]
    for shape in range(shapes.shape[0]):
        compose(places[shapes[shape, JOINT]], values[shape, :12], poses[shape])


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


@inner
def near_pairs(contacts: Contacts, rates: Array, span: float, slack: float) -> int:
    """Fill ``boxes`` and ``margins``, and return how many pairs are near, by bounding boxes.

    Args:
        contacts: placed; see :func:`place_shapes`.
        rates: (nv,) expected.
        span: s ahead.
        slack: share of a shape's size by which it may be apart, moving or not.
    """
    shapes, values, boxes = contacts.shapes, contacts.shape_values, contacts.boxes
    poses, axes, moves = contacts.poses, contacts.axes, contacts.moves
    for shape in range(shapes.shape[0]):
        moving = moves[shapes[shape, JOINT]]
        _bound(values[shape], poses[shape], axes, moving, rates, span, slack, boxes[shape])
    pairs, margins, count = contacts.pairs, contacts.margins, 0
    for pair in range(pairs.shape[0]):
        a, b = pairs[pair, SHAPE_A], pairs[pair, SHAPE_B]
        margin = boxes[a, 6] + boxes[b, 6]
        if shapes[a, KIND] == HALF_SPACE:
            near = _height(poses[a], boxes[b]) <= margin
        elif shapes[b, KIND] == HALF_SPACE:
            near = _height(poses[b], boxes[a]) <= margin
        else:
            near = True
            for i in range(3):
                gap = abs(boxes[a, 3 + i] - boxes[b, 3 + i]) - boxes[a, i] - boxes[b, i]
                near = near and gap <= margin
        margins[pair] = margin if near else -1.0
        count += 1 if near else 0
    return count


@inner
def needs_search(contacts: Contacts) -> bool:
    """Return whether the nearest points of a pair that is near have to be searched for."""
    pairs, margins = contacts.pairs, contacts.margins
    for pair in range(pairs.shape[0]):
        if margins[pair] >= 0.0 and pairs[pair, NEEDS_SEARCH] != 0:
            return True
    return False
