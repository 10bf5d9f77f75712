# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Shapes as instances of a few unit bodies: arrays that a page sends whole, one set for each body.

An instance keeps its place in the arrays as long as its shape is drawn, so that what is grabbed at
a place is known by it. Places that are free are drawn without size.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from itertools import pairwise
from typing import Literal

import numpy as np

from hapticmech_ros.arrays import Array
from hapticmech_ros.quaternions import quaternion_of
from hapticmech_ros.view import Shape
from hapticmech_ros.view.palette import Colour
from hapticmech_ros.view.shapes import rotation_to

Body = Literal["sphere", "cylinder", "box", "cone"]
BODIES: tuple[Body, ...] = ("sphere", "cylinder", "box", "cone")
# Corners of what is round: few, as every one of every instance takes time where no GPU draws them.
_AROUND, _RINGS = 12, 6
# Places are made in such steps, so that an arrow more is seldom a new set.
_STEP = 4
# What is not drawn has this size, m: with none its place could not be computed back.
_NOTHING = 1e-9
_UPRIGHT = np.array((1.0, 0.0, 0.0, 0.0))
# (body, part of the shape, centre, quaternion w x y z, scale, colour)
_Part = tuple[Body, int, Array, Array, Array, Colour]


@dataclass(slots=True)
class InstanceArrays:
    """Instances of one body.

    Attributes:
        positions: (n, 3) m.
        quaternions: (n, 4) w, x, y, z.
        scales: (n, 3) m.
        colours: (n, 3) red, green and blue, 0 to 255.
        opacities: (n,) 0 to 1.
        shapes: what is drawn at each place; None where nothing is.
    """

    positions: Array
    quaternions: Array
    scales: Array
    colours: Array
    opacities: Array
    shapes: list[Shape | None]


class Instances:
    """Instances of one body, frame by frame."""

    def __init__(self) -> None:
        self._places: dict[tuple[str, int, int], int] = {}
        self._free: list[int] = []
        self._size = 0

    def arranged(self, parts: Sequence[tuple[Shape, _Part]]) -> InstanceArrays:
        """Return the arrays of a frame; they grow where more is drawn than ever before."""
        keys = [(*shape.key, part[1]) for shape, part in parts]
        for gone in self._places.keys() - set(keys):
            self._free.append(self._places.pop(gone))
        for key in keys:
            if key not in self._places:
                if not self._free:
                    self._free = list(range(self._size + _STEP - 1, self._size - 1, -1))
                    self._size += _STEP
                self._places[key] = self._free.pop()
        n = self._size
        found = InstanceArrays(
            np.zeros((n, 3), dtype=np.float32),
            np.tile(_UPRIGHT.astype(np.float32), (n, 1)),
            np.full((n, 3), _NOTHING, dtype=np.float32),
            np.zeros((n, 3), dtype=np.uint8),
            np.zeros(n, dtype=np.float32),
            [None] * n,
        )
        for key, (shape, (_, _, centre, quaternion, scale, colour)) in zip(
            keys, parts, strict=True
        ):
            at = self._places[key]
            found.positions[at], found.quaternions[at] = centre, quaternion
            found.scales[at] = np.maximum(scale, _NOTHING)
            found.colours[at] = [round(255 * part) for part in colour[:3]]
            found.opacities[at] = colour[3]
            found.shapes[at] = shape
        return found


def instance_parts(shapes: Sequence[Shape]) -> dict[Body, list[tuple[Shape, _Part]]]:
    """Return shapes as parts, by body; lines are none, and texts and triangles are left out."""
    found: dict[Body, list[tuple[Shape, _Part]]] = {body: [] for body in BODIES}
    for shape in shapes:
        for part in _parts(shape):
            found[part[0]].append((shape, part))
    return found


def line_segments(shapes: Sequence[Shape]) -> tuple[Array, Array]:
    """Return (n, 2, 3) ends, m, and (n, 2, 3) colours, 0 to 255, of the lines among shapes."""
    ends: list[Array] = []
    colours: list[tuple[Colour, int]] = []
    for shape in shapes:
        if shape.kind == "strip":
            ends.append(np.stack((shape.points[:-1], shape.points[1:]), axis=1))
            colours.append((shape.colour, len(shape.points) - 1))
    if not ends:
        return np.zeros((0, 2, 3)), np.zeros((0, 2, 3), dtype=np.uint8)
    rgb = [np.tile(np.array(colour[:3]), (count, 2, 1)) for colour, count in colours]
    return np.concatenate(ends), np.round(255.0 * np.concatenate(rgb)).astype(np.uint8)


def _parts(shape: Shape) -> list[_Part]:
    colour = shape.colour
    if shape.kind in ("sphere", "cylinder", "box"):
        body: Body = "sphere" if shape.kind == "sphere" else "box"
        if shape.kind == "cylinder":
            body = "cylinder"
        turned = _wxyz(shape.pose.rotation)
        return [(body, 0, shape.pose.translation, turned, np.array(shape.size), colour)]
    if shape.kind == "arrow":
        tail, tip = shape.points
        shaft, head, length = shape.size
        along = (tip - tail) / float(np.linalg.norm(tip - tail))
        neck, turned = tip - length * along, _wxyz(rotation_to(along))
        long = float(np.linalg.norm(neck - tail))
        return [
            ("cylinder", 0, 0.5 * (tail + neck), turned, np.array((shaft, shaft, long)), colour),
            ("cone", 1, 0.5 * (neck + tip), turned, np.array((head, head, length)), colour),
        ]
    return []


def _wxyz(rotation: Array) -> Array:
    return np.roll(quaternion_of(rotation), 1)


@cache
def unit_body(body: Body) -> tuple[Array, Array]:
    """Return corners (n, 3) and triangles (k, 3) of a body of diameter, edges and height 1.

    Its centre is at the origin, and its axis along z; a cone's tip is at z = 0.5. Seen from outside
    each triangle turns left.
    """
    if body == "box":
        corners = np.array(
            [(x, y, z) for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)]
        )
        sides = ((0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3))
        return corners, np.array([t for a, b, c, d in sides for t in ((a, b, c), (a, c, d))])
    if body == "sphere":
        tilt = np.linspace(0.0, np.pi, _RINGS + 1)
        profile = np.column_stack((0.5 * np.sin(tilt), 0.5 * np.cos(tilt)))
    elif body == "cylinder":
        profile = np.array(
            ((0.0, 0.5), (0.5, 0.5), (0.5, 0.5), (0.5, -0.5), (0.5, -0.5), (0.0, -0.5))
        )
    else:
        profile = np.array(((0.0, 0.5), (0.5, -0.5), (0.5, -0.5), (0.0, -0.5)))
    return _turned(profile)


def _turned(profile: Array) -> tuple[Array, Array]:
    """Return a body of revolution about z; profile (m, 2) of radius and height goes downwards."""
    turn = np.linspace(0.0, 2.0 * np.pi, _AROUND, endpoint=False)
    corners: list[tuple[float, float, float]] = []
    rows: list[list[int]] = []
    for radius, height in profile.tolist():
        around = turn if radius > _NOTHING else turn[:1]
        first = len(corners)
        corners += [(radius * np.cos(a), radius * np.sin(a), height) for a in around]
        rows.append([first + i % len(around) for i in range(_AROUND + 1)])
    triangles = []
    for above, below in pairwise(rows):
        for i in range(_AROUND):
            a, b, c, d = above[i], above[i + 1], below[i], below[i + 1]
            triangles += [t for t in ((a, c, d), (a, d, b)) if len(set(t)) == len(t)]
    places, found = np.array(corners), np.array(triangles)
    edges = places[found]
    area = np.linalg.norm(np.cross(edges[:, 1] - edges[:, 0], edges[:, 2] - edges[:, 0]), axis=1)
    return places, found[area > _NOTHING**2]
