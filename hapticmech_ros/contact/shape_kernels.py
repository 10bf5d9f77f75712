# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Shapes inside kernels: where they are, how far they reach, and their faces, edges and corners.

A shape is a row of whole numbers and one of floats. Poses are kept as twelve numbers: the axes of
the frame one after the other, then its origin. A polytope is a box or the hull of a mesh.

Broad phase: declared pairs that are near enough to touch in a step, by bounding boxes along the
world's axes, widened by how far a shape can come in the time ahead.
"""

from __future__ import annotations

import numpy as np

from hapticmech_ros.arrays import Array
from hapticmech_ros.compilation import inner, local
from hapticmech_ros.contact.layout import (
    CYLINDER,
    FIRST_FACE,
    FIRST_VERTEX,
    HALF_LENGTH,
    HALF_SIZE,
    HALF_SPACE,
    JOINT,
    KIND,
    LAST_FACE,
    LAST_VERTEX,
    MIDDLE,
    NEEDS_SEARCH,
    POLYTOPE,
    RADIUS,
    SHAPE_A,
    SHAPE_B,
    SPHERE,
    Contacts,
)
from hapticmech_ros.mechanism.kernels.data import Data

# Corners that a polygon may have, and those that stand for a disk: as the face of a cylinder that
# others lie on, or as what lies on another's face. Four already resist tilting alike all around.
MOST_CORNERS, DISK_CORNERS, LYING_DISK_CORNERS = 16, 8, 4
# A cylinder lies on its end where that is nearer to the direction asked for than its side.
_ON_END = 0.7071067811865476


@inner
def along_axis(pose: Array, axis: int, x: float, y: float, z: float) -> float:
    """Return the part of a vector along an axis of a pose."""
    return float(pose[3 * axis] * x + pose[3 * axis + 1] * y + pose[3 * axis + 2] * z)


@inner
def put_point(pose: Array, x: float, y: float, z: float, out: Array) -> None:
    """Put a point of a frame into ``out`` (3,), world axes, m."""
    for i in range(3):
        out[i] = pose[9 + i] + x * pose[i] + y * pose[3 + i] + z * pose[6 + i]


@inner
def compose(outer: Array, local: Array, out: Array) -> None:
    """Put the pose of a frame, given in another, into ``out`` (12,)."""
    for axis in range(3):
        for i in range(3):
            total = 0.0
            for k in range(3):
                total += local[3 * axis + k] * outer[3 * k + i]
            out[3 * axis + i] = total
    put_point(outer, local[9], local[10], local[11], out[9:])


@inner
def support(contacts: Contacts, shape: int, direction: Array) -> tuple[float, int]:
    """Return how far a bounded shape reaches along a unit vector, m, and a polytope's vertex."""
    numbers, values, pose = (
        contacts.shapes[shape],
        contacts.shape_values[shape],
        contacts.poses[shape],
    )
    x = along_axis(pose, 0, direction[0], direction[1], direction[2])
    y = along_axis(pose, 1, direction[0], direction[1], direction[2])
    z = along_axis(pose, 2, direction[0], direction[1], direction[2])
    middle = pose[9] * direction[0] + pose[10] * direction[1] + pose[11] * direction[2]
    kind = numbers[KIND]
    if kind == POLYTOPE:
        most, found, vertices = -np.inf, 0, contacts.vertices
        for i in range(numbers[FIRST_VERTEX], numbers[LAST_VERTEX]):
            reach = vertices[i, 0] * x + vertices[i, 1] * y + vertices[i, 2] * z
            if reach > most:
                most, found = reach, i
        return float(middle + most), found
    reach = abs(z) * values[HALF_LENGTH]
    if kind == CYLINDER:
        return float(middle + reach + values[RADIUS] * np.sqrt(x * x + y * y)), 0
    return float(middle + reach + values[RADIUS]), 0


@inner
def face_normal(contacts: Contacts, shape: int, direction: Array, out: Array) -> bool:
    """Put the outward normal of the face that faces a direction most into ``out`` (3,).

    Returns:
        Whether the shape has such a face, less than 45° away.
    """
    numbers, pose, normals = contacts.shapes[shape], contacts.poses[shape], contacts.normals
    z = along_axis(pose, 2, direction[0], direction[1], direction[2])
    if numbers[KIND] == CYLINDER:
        for i in range(3):
            out[i] = pose[6 + i] if z > 0.0 else -pose[6 + i]
        return abs(z) > _ON_END
    if numbers[KIND] != POLYTOPE:
        return False
    x = along_axis(pose, 0, direction[0], direction[1], direction[2])
    y = along_axis(pose, 1, direction[0], direction[1], direction[2])
    most, found = -1.0, 0
    for face in range(numbers[FIRST_FACE], numbers[LAST_FACE]):
        cosine = normals[face, 0] * x + normals[face, 1] * y + normals[face, 2] * z
        if cosine > most:
            most, found = cosine, face
    for i in range(3):
        out[i] = (
            normals[found, 0] * pose[i]
            + normals[found, 1] * pose[3 + i]
            + normals[found, 2] * pose[6 + i]
        )
    return most > _ON_END


@inner
def _cylinder_feature(
    radius: float, half: float, pose: Array, direction: Array, disk_corners: int, out: Array
) -> int:
    """Put a cylinder's end as a polygon, or a line along its side, into ``out``."""
    x = along_axis(pose, 0, direction[0], direction[1], direction[2])
    y = along_axis(pose, 1, direction[0], direction[1], direction[2])
    z = along_axis(pose, 2, direction[0], direction[1], direction[2])
    across = np.sqrt(x * x + y * y)
    cosine, sine = (x / across, y / across) if across > 0.0 else (1.0, 0.0)
    if abs(z) <= _ON_END:
        put_point(pose, radius * cosine, radius * sine, half, out[0])
        put_point(pose, radius * cosine, radius * sine, -half, out[1])
        return 2
    # Begun at the corner that reaches furthest.
    for k in range(disk_corners):
        angle = 2.0 * np.pi * k / disk_corners
        c, s = np.cos(angle), np.sin(angle)
        right, up = radius * (c * cosine - s * sine), radius * (s * cosine + c * sine)
        put_point(pose, right, up, half if z > 0.0 else -half, out[k])
    return disk_corners


@inner
def _polytope_face(contacts: Contacts, shape: int, direction: Array, out: Array) -> int:
    """Put the face that faces a direction most, of those at the furthest vertex, into ``out``."""
    numbers, pose, vertices = contacts.shapes[shape], contacts.poses[shape], contacts.vertices
    faces, corners, normals = contacts.faces, contacts.corners, contacts.normals
    _, vertex = support(contacts, shape, direction)
    x = along_axis(pose, 0, direction[0], direction[1], direction[2])
    y = along_axis(pose, 1, direction[0], direction[1], direction[2])
    z = along_axis(pose, 2, direction[0], direction[1], direction[2])
    most, found = -2.0, numbers[FIRST_FACE]
    for face in range(numbers[FIRST_FACE], numbers[LAST_FACE]):
        cosine = normals[face, 0] * x + normals[face, 1] * y + normals[face, 2] * z
        if cosine > most:
            for k in range(faces[face, 0], faces[face, 0] + faces[face, 1]):
                if corners[k] == vertex:
                    most, found = cosine, face
    first, many = faces[found, 0], faces[found, 1]
    count = int(min(many, MOST_CORNERS))
    for k in range(count):
        corner = corners[first + k * many // count]
        put_point(pose, vertices[corner, 0], vertices[corner, 1], vertices[corner, 2], out[k])
    return count


@inner
def feature(contacts: Contacts, shape: int, direction: Array, disk_corners: int, out: Array) -> int:
    """Put the point, edge or face that reaches furthest along a unit vector into ``out``.

    Returns:
        How many rows of ``out`` (16, 3) it has: corners of a polygon in order, ends of an edge.
    """
    kind = contacts.shapes[shape, KIND]
    if kind == POLYTOPE:
        return _polytope_face(contacts, shape, direction, out)
    values, pose = contacts.shape_values[shape], contacts.poses[shape]
    radius, half = values[RADIUS], values[HALF_LENGTH]
    if kind == CYLINDER:
        return _cylinder_feature(radius, half, pose, direction, disk_corners, out)
    count = 1 if kind == SPHERE else 2
    for end in range(count):
        put_point(pose, 0.0, 0.0, half if end == 0 else -half, out[end])
        for i in range(3):
            out[end, i] += radius * direction[i]
    return count


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
