# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Where two shapes touch: at most four points, each with its own depth.

Shapes touch along a normal. Where a face of one of them has that normal, the other's face, edge or
corner is clipped by the sides of it, and each corner that is left has its own depth below the
face: so a box rests on four points, and tilts about them. Elsewhere edges cross, or curved
surfaces touch, in one point.
"""

from __future__ import annotations

import numpy as np

from hapticmech_ros.arrays import Array
from hapticmech_ros.compilation import inner, kernel, local, local_whole, shaped
from hapticmech_ros.contact.clip_kernels import MOST_BELOW, along_edges, below_plane, on_face
from hapticmech_ros.contact.layout import (
    HALF_SIZE,
    HALF_SPACE,
    KIND,
    MOST_POINTS,
    SHAPE_A,
    SHAPE_B,
    Contacts,
)
from hapticmech_ros.contact.shape_kernels import face_normal, support
from hapticmech_ros.mechanism.kernels.small_matrices import dot

# A face counts as what touches if it faces the other shape to within this angle, rad: at smaller
# ones the search for the nearest points tells edges from faces by chance. It does as well if the
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

    They are put on one plane across the normal, in the middle of what they are: then a body that
    rocks on them does not slip at some against others, which nothing but huge forces between them
    could prevent. Along the normal nothing changes.
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
        for i in range(3):
            points[k, i] += lift * normal[i]
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
            for i in range(3):
                down[i] = -trial[i]
            own, _ = support(contacts, base, trial)
            facing, _ = support(contacts, other, down)
            apart = -own - facing
            close = cosine > 1.0 - 0.5 * _FACING * _FACING or apart >= least
            if close and apart > best:
                best, side = apart + _FIRST * size, -int(sign)
                for i in range(3):
                    normal[i] = trial[i]
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
        for i in range(3):
            normal[i] = contacts.poses[plane, 6 + i]
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
    for i in range(3):
        normal[i] = -found[i]
    count = along_edges(contacts, a, b, normal, above, depths)
    if count == 0:
        for i in range(3):
            above[0, i] = found[4 + i]
        depths[0] = -found[3]
        count = 1
    return _chosen(above, depths, count, normal, True, points)


@kernel("int64(int64[::1], float64[::1])", linked=True)
def touching_points(numbers: Array, values: Array) -> int:
    """Fill ``points`` and ``owners`` with where the pairs that are near touch; return how many.

    ``poses``, ``margins`` and, of pairs that have to be searched for, ``found`` are given.

    Args:
        numbers: (integers,) of the contacts, whole ones.
        values: (numbers,) the others; see ``layout.Contacts``.
    """
    contacts = Contacts(numbers, values)
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
