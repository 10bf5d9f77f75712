# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What of a shape lies on another: below a plane, over a face, or along an edge.

Points are put into ``above`` (64, 3), m, world, with their ``depths`` (64,) below the surface.
"""

from __future__ import annotations

from hapticmech_ros.arrays import Array
from hapticmech_ros.compilation import inner, local, shaped
from hapticmech_ros.contact.layout import FIRST_VERTEX, KIND, LAST_VERTEX, POLYTOPE, Contacts
from hapticmech_ros.contact.shape_kernels import (
    DISK_CORNERS,
    LYING_DISK_CORNERS,
    MOST_CORNERS,
    feature,
    put_point,
)

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
    down, shapes, poses = local(3), contacts.shapes, contacts.poses
    for i in range(3):
        down[i] = -poses[plane, 6 + i]
    level = 0.0
    for i in range(3):
        level += down[i] * poses[plane, 9 + i]
    count = 0
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
        for i in range(3):
            above[count, i] = polygon[k, i]
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
            for i in range(3):
                out[kept, i] = lying[k, i]
            kept += 1
        # An edge has no way back from its end.
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
    """Put what of the other shape lies over a face of ``base`` into ``above``."""
    face = shaped(local(MOST_CORNERS * 3), (MOST_CORNERS, 3))
    lying = shaped(local(MOST_BELOW * 3), (MOST_BELOW, 3))
    clipped = shaped(local(MOST_BELOW * 3), (MOST_BELOW, 3))
    down = local(3)
    for i in range(3):
        down[i] = -normal[i]
    sides = feature(contacts, base, normal, DISK_CORNERS, face)
    count = feature(contacts, other, down, LYING_DISK_CORNERS, lying)
    for k in range(sides):
        count = _clip(lying, count, face[k], face[(k + 1) % sides], normal, clipped)
        for j in range(count):
            for i in range(3):
                lying[j, i] = clipped[j, i]
    level = 0.0
    for i in range(3):
        level += down[i] * face[0, i]
    kept = 0
    for k in range(count):
        for i in range(3):
            above[kept, i] = lying[k, i]
        kept = kept_if_below(above, depths, kept, down, level, margin)
    return kept


@inner
def _length_along(start: Array, end: Array, along: Array) -> float:
    """Return the part along a vector of the way from one point to another, times its length."""
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
    for i in range(3):
        back[i] = -normal[i]
    many_a = feature(contacts, a, back, 4, edge_a)
    many_b = feature(contacts, b, normal, 4, edge_b)
    if many_a != 2 or many_b != 2:
        return 0
    for i in range(3):
        along[i], across[i] = edge_a[1, i] - edge_a[0, i], edge_b[1, i] - edge_b[0, i]
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
