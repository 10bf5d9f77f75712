# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Where two shapes touch: at most four points, each with its own depth.

Shapes touch along a normal. Where a face of one of them has that normal, the other's face, edge or
corner is clipped by the sides of it, and each corner that is left has its own depth below the
face: so a box rests on four points, and tilts about them. Elsewhere edges cross, or curved
surfaces touch, in one point.

Points found by clipping are put into ``above`` (64, 3), m, world, with their ``depths`` (64,) below
the surface.

Shapes inside kernels: where they are, how far they reach, and their faces, edges and corners.

A shape is a row of whole numbers and one of floats. Poses are kept as twelve numbers: the axes of
the frame one after the other, then its origin. A polytope is a box or the hull of a mesh.

Broad phase: declared pairs that are near enough to touch in a step, by bounding boxes along the
world's axes, widened by how far a shape can come in the time ahead.
"""

from __future__ import annotations

import numpy as np

from hapticmech_ros.compilation import inner, kernel, local, local_whole, put, shaped
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
    MOST_POINTS,
    NEEDS_SEARCH,
    POLYTOPE,
    RADIUS,
    SHAPE_A,
    SHAPE_B,
    SPHERE,
    Contacts,
)
from hapticmech_ros.mechanism.kernels.model import Data
from hapticmech_ros.numerics import Array
from hapticmech_ros.numerics.small_matrices import add_scaled, dot, negate3, put3, subtract3

# Corners that a polygon may have, and those that approximate a disk: as a cylinder's face below
# other shapes, or lying on another's face. Four already resist tilting alike all around.
MOST_CORNERS, DISK_CORNERS, LYING_DISK_CORNERS = 16, 8, 4
# A cylinder lies on its end where that is nearer to the requested direction than its side.
_ON_END = 0.7071067811865476


@inner
def in_frame(pose: Array, vector: Array) -> tuple[float, float, float]:
    """Return the parts of a vector (3,) along the axes of a pose."""
    a, b, c = vector[0], vector[1], vector[2]
    return (
        float(pose[0] * a + pose[1] * b + pose[2] * c),
        float(pose[3] * a + pose[4] * b + pose[5] * c),
        float(pose[6] * a + pose[7] * b + pose[8] * c),
    )


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
    x, y, z = in_frame(pose, direction)
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
    x, y, z = in_frame(pose, direction)
    if numbers[KIND] == CYLINDER:
        for i in range(3):
            out[i] = pose[6 + i] if z > 0.0 else -pose[6 + i]
        return abs(z) > _ON_END
    if numbers[KIND] != POLYTOPE:
        return False
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
    x, y, z = in_frame(pose, direction)
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
    x, y, z = in_frame(pose, direction)
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
        add_scaled(out[end], radius, direction)
    return count


@inner
def place_shapes(contacts: Contacts, data: Data) -> None:
    """Fill ``axes`` and ``poses`` at the configuration that ``data`` was filled at."""
    values, shapes = contacts.shape_values, contacts.shapes
    poses, places = contacts.poses, data.places
    put(contacts.axes, data.joint_jacobian)
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
            add_scaled(twist, rates[rate], axes[rate])
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


# Points of a shape that may lie on another.
MOST_BELOW = 64
# Edges closer to parallel than this sine touch in two points.
_PARALLEL = 0.05


@inner
def kept_if_below(
    above: Array, depths: Array, count: int, down: Array, level: float, margin: float
) -> int:
    """Return how many points there are, with the last one if it is below a plane, or nearly."""
    depth = -level
    for i in range(3):
        depth += down[i] * above[count, i]
    depths[count] = depth
    return count + 1 if depth > -margin else count


@inner
def below_plane(
    contacts: Contacts, plane: int, other: int, margin: float, above: Array, depths: Array
) -> int:
    """Put the points of a shape that are in a half-space, or nearly, into ``above``."""
    down, shapes, poses, count = local(3), contacts.shapes, contacts.poses, 0
    negate3(poses[plane, 6:], down)
    level = dot(down, poses[plane, 9:])
    if shapes[other, KIND] == POLYTOPE:
        vertices = contacts.vertices
        for k in range(shapes[other, FIRST_VERTEX], shapes[other, LAST_VERTEX]):
            if count < MOST_BELOW:
                x, y, z = vertices[k, 0], vertices[k, 1], vertices[k, 2]
                put_point(poses[other], x, y, z, above[count])
                count = kept_if_below(above, depths, count, down, level, margin)
        return count
    polygon = shaped(local(MOST_CORNERS * 3), (MOST_CORNERS, 3))
    many = feature(contacts, other, down, LYING_DISK_CORNERS, polygon)
    for k in range(many):
        put3(above[count], polygon[k])
        count = kept_if_below(above, depths, count, down, level, margin)
    return count


@inner
def _beyond(point: Array, start: Array, x: float, y: float, z: float) -> float:
    return float(x * (point[0] - start[0]) + y * (point[1] - start[1]) + z * (point[2] - start[2]))


@inner
def _clip(lying: Array, count: int, start: Array, end: Array, normal: Array, out: Array) -> int:
    """Put the part of a polygon, edge or point inside one side of a face into ``out``."""
    x = (end[1] - start[1]) * normal[2] - (end[2] - start[2]) * normal[1]
    y = (end[2] - start[2]) * normal[0] - (end[0] - start[0]) * normal[2]
    z = (end[0] - start[0]) * normal[1] - (end[1] - start[1]) * normal[0]
    kept = 0
    for k in range(count):
        here = _beyond(lying[k], start, x, y, z)
        if here <= 0.0:
            put3(out[kept], lying[k])
            kept += 1
        # An edge does not close.
        if count == 1 or (count == 2 and k == 1):
            continue
        following = (k + 1) % count
        there = _beyond(lying[following], start, x, y, z)
        if (here < 0.0 < there) or (there < 0.0 < here):
            share = here / (here - there)
            for i in range(3):
                out[kept, i] = lying[k, i] + share * (lying[following, i] - lying[k, i])
            kept += 1
    return kept


@inner
def on_face(
    contacts: Contacts,
    base: int,
    other: int,
    normal: Array,
    margin: float,
    above: Array,
    depths: Array,
) -> int:
    """Put the other shape's corners over a face of ``base`` into ``above``."""
    face = shaped(local(MOST_CORNERS * 3), (MOST_CORNERS, 3))
    lying = shaped(local(MOST_BELOW * 3), (MOST_BELOW, 3))
    clipped = shaped(local(MOST_BELOW * 3), (MOST_BELOW, 3))
    down = local(3)
    negate3(normal, down)
    sides = feature(contacts, base, normal, DISK_CORNERS, face)
    count = feature(contacts, other, down, LYING_DISK_CORNERS, lying)
    for k in range(sides):
        count = _clip(lying, count, face[k], face[(k + 1) % sides], normal, clipped)
        for j in range(count):
            put3(lying[j], clipped[j])
    level, kept = dot(down, face[0]), 0
    for k in range(count):
        put3(above[kept], lying[k])
        kept = kept_if_below(above, depths, kept, down, level, margin)
    return kept


@inner
def _length_along(start: Array, end: Array, along: Array) -> float:
    """Return the part along a vector of the displacement between two points, times its length."""
    return float(
        (end[0] - start[0]) * along[0]
        + (end[1] - start[1]) * along[1]
        + (end[2] - start[2]) * along[2]
    )


@inner
def along_edges(
    contacts: Contacts, a: int, b: int, normal: Array, above: Array, depths: Array
) -> int:
    """Put the ends of the line along which two round shapes side by side touch into ``above``."""
    edge_a = shaped(local(MOST_CORNERS * 3), (MOST_CORNERS, 3))
    edge_b = shaped(local(MOST_CORNERS * 3), (MOST_CORNERS, 3))
    if contacts.shapes[a, KIND] == POLYTOPE or contacts.shapes[b, KIND] == POLYTOPE:
        return 0
    back, along, across = local(3), local(3), local(3)
    negate3(normal, back)
    many_a = feature(contacts, a, back, 4, edge_a)
    many_b = feature(contacts, b, normal, 4, edge_b)
    if many_a != 2 or many_b != 2:
        return 0
    subtract3(edge_a[1], edge_a[0], along)
    subtract3(edge_b[1], edge_b[0], across)
    square = _length_along(edge_a[0], edge_a[1], along)
    other = _length_along(edge_b[0], edge_b[1], across)
    product = _length_along(edge_b[0], edge_b[1], along)
    if square * other - product * product > _PARALLEL * _PARALLEL * square * other:
        return 0
    start = _length_along(edge_a[0], edge_b[0], along) / square
    end = _length_along(edge_a[0], edge_b[1], along) / square
    low, high = max(0.0, min(start, end)), min(1.0, max(start, end))
    if high <= low:
        return 0
    for k in range(2):
        where = low if k == 0 else high
        share = (where - start) / (end - start)
        depth = 0.0
        for i in range(3):
            above[k, i] = edge_a[0, i] + where * along[i]
            depth += normal[i] * (edge_b[0, i] + share * across[i] - above[k, i])
        depths[k] = depth
    return 2


# A face is taken as touching if it faces the other shape to within this angle, rad: at smaller ones
# the search for the nearest points distinguishes edges from faces by chance. It does as well if the
# shapes are as far apart along its normal, to this share of their distance and of their size.
_FACING = 0.1
_FACE_SHARE, _FACE_SLACK = 1e-3, 1e-7
# b's face goes before a's unless shapes overlap less along the latter, by this share of their size:
# which one it is must not flicker.
_FIRST = 0.01
# Across a normal with less of it along x, tangents begin with x.
_MOSTLY = 0.8
# The deepest of many points goes before one that is further out if it is deeper by this share of
# their extent.
_DEEPER = 0.01


@inner
def tangents(normal: Array, first: Array, second: Array) -> None:
    """Put two unit vectors across a normal, and across each other, into ``first``, ``second``."""
    # Not the axis least along it: which one that is may flicker.
    least = 0 if abs(normal[0]) < _MOSTLY else 1
    i, j, k = least, (least + 1) % 3, (least + 2) % 3
    size = np.sqrt(normal[j] * normal[j] + normal[k] * normal[k])
    first[i], first[j], first[k] = 0.0, -normal[k] / size, normal[j] / size
    for axis in range(3):
        p, q = (axis + 1) % 3, (axis + 2) % 3
        second[axis] = normal[p] * first[q] - normal[q] * first[p]


@inner
def _spread(above: Array, depths: Array, count: int, normal: Array, chosen: Array) -> int:
    """Choose the points that reach furthest along four directions, and the deepest one.

    By where they are, not by depths that differ in rounding: the choice must not flicker.
    """
    first, second = local(3), local(3)
    tangents(normal, first, second)
    kept, deepest, extent = 0, 0, 0.0
    for k in range(count):
        if depths[k] > depths[deepest]:
            deepest = k
    for turn in range(4):
        c, s = (1.0, 0.3) if turn % 2 == 0 else (-0.3, 1.0)
        sign = 1.0 if turn < 2 else -1.0
        most, best = -np.inf, 0
        for k in range(count):
            reach = 0.0
            for i in range(3):
                reach += sign * (c * first[i] + s * second[i]) * (above[k, i] - above[0, i])
            if reach > most:
                most, best = reach, k
        extent = max(extent, most)
        known = False
        for k in range(kept):
            known = known or chosen[k] == best
        if not known:
            chosen[kept] = best
            kept += 1
    reached = -np.inf
    for k in range(kept):
        reached = max(reached, depths[chosen[k]])
    if depths[deepest] > reached + _DEEPER * extent:
        chosen[kept if kept < MOST_POINTS else 0] = deepest
        kept = min(kept + 1, MOST_POINTS)
    return kept


@inner
def _chosen(
    above: Array, depths: Array, count: int, normal: Array, lies_on_b: bool, points: Array
) -> int:
    """Fill rows of ``points``: all if there are no more than four, else those furthest apart.

    They are moved to one plane across the normal, at their mean height: then a body that rocks on
    them does not slip at some against others, which only huge forces between them could prevent.
    Along the normal nothing changes.
    """
    chosen = local_whole(MOST_POINTS)
    kept = min(count, MOST_POINTS)
    for k in range(kept):
        chosen[k] = k
    if count > MOST_POINTS:
        kept = _spread(above, depths, count, normal, chosen)
    sign, level = 1.0 if lies_on_b else -1.0, 0.0
    for k in range(kept):
        depth = depths[chosen[k]]
        for i in range(3):
            points[k, i] = above[chosen[k], i] + 0.5 * depth * normal[i]
            points[k, 3 + i] = sign * normal[i]
            level += normal[i] * points[k, i] / kept
        points[k, 6] = depth
    for k in range(kept):
        lift = level
        for i in range(3):
            lift -= normal[i] * points[k, i]
        add_scaled(points[k, :3], lift, normal)
    return int(kept)


@inner
def _face_between(contacts: Contacts, a: int, b: int, found: Array, normal: Array) -> int:
    """Return whose face two bounded shapes touch on: 1 for b's, -1 for a's, 0 for none.

    ``normal`` becomes the outward one of that face.
    """
    direction, trial, down = local(3), local(3), local(3)
    values = contacts.shape_values
    size = min(_size(values[a]), _size(values[b]))
    least = found[3] - _FACE_SHARE * abs(found[3]) - _FACE_SLACK * size
    best, side = -np.inf, 0
    for turn in range(2):
        base, other, sign = (b, a, -1.0) if turn == 0 else (a, b, 1.0)
        for i in range(3):
            direction[i] = sign * found[i]
        if face_normal(contacts, base, direction, trial):
            cosine = dot(direction, trial)
            negate3(trial, down)
            own, _ = support(contacts, base, trial)
            facing, _ = support(contacts, other, down)
            apart = -own - facing
            close = cosine > 1.0 - 0.5 * _FACING * _FACING or apart >= least
            if close and apart > best:
                best, side = apart + _FIRST * size, -int(sign)
                put3(normal, trial)
    return side


@inner
def _size(values: Array) -> float:
    return float(values[HALF_SIZE] + values[HALF_SIZE + 1] + values[HALF_SIZE + 2])


@inner
def _touching(
    contacts: Contacts, a: int, b: int, margin: float, found: Array, points: Array
) -> int:
    """Fill ``points`` (4, 7) with where shapes a and b touch, and return how many there are."""
    above = shaped(local(MOST_BELOW * 3), (MOST_BELOW, 3))
    depths, shapes = local(MOST_BELOW), contacts.shapes
    normal = local(3)
    lies_on_b = shapes[b, KIND] == HALF_SPACE
    if lies_on_b or shapes[a, KIND] == HALF_SPACE:
        plane, other = (b, a) if lies_on_b else (a, b)
        put3(normal, contacts.poses[plane, 6:])
        count = below_plane(contacts, plane, other, margin, above, depths)
        return _chosen(above, depths, count, normal, lies_on_b, points)
    side = _face_between(contacts, a, b, found, normal)
    if side != 0:
        base, other = (b, a) if side > 0 else (a, b)
        count = on_face(contacts, base, other, normal, margin, above, depths)
        if count > 0:
            return _chosen(above, depths, count, normal, side > 0, points)
    if found[3] > margin:
        return 0
    negate3(found, normal)
    count = along_edges(contacts, a, b, normal, above, depths)
    if count == 0:
        put3(above[0], found[4:])
        depths[0], count = -found[3], 1
    return _chosen(above, depths, count, normal, True, points)


@kernel("int64(Contacts)", linked=True)
def touching_points(contacts: Contacts) -> int:
    """Fill ``points`` and ``owners`` with where the pairs that are near touch; return how many.

    ``poses``, ``margins`` and, of pairs that have to be searched for, ``found`` are given.
    """
    margins, pairs, points, count = contacts.margins, contacts.pairs, contacts.points, 0
    found, owners = contacts.found, contacts.owners
    for pair in range(pairs.shape[0]):
        if margins[pair] < 0.0:
            continue
        more = _touching(
            contacts,
            pairs[pair, SHAPE_A],
            pairs[pair, SHAPE_B],
            margins[pair],
            found[pair],
            points[count:],
        )
        for k in range(count, count + more):
            owners[k] = pair
        count += more
    return count
