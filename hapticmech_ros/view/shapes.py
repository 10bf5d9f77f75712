# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Shapes as frozen descriptions: what a marker, or any other picture, is made from.

Positions are in ``world``, m. A shape is known by its namespace and number, which stay the same
from picture to picture.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np
import pinocchio as pin

from hapticmech_ros.arrays import Array
from hapticmech_ros.view.palette import Colour

Kind = Literal["cylinder", "sphere", "box", "arrow", "strip", "text", "triangles"]
Key = tuple[str, int]
# An arrow's head is no longer than this share of the arrow.
LONGEST_HEAD = 0.4
# A ring is open by this share of a turn, so that its arrowhead can be seen; drawn by corners.
RING_GAP = 0.15
RING_CORNERS = 24
# Shorter than this (m) nothing has a direction.
_NOTHING = 1e-9


@dataclass(frozen=True, slots=True)
class Shape:
    """One shape.

    Attributes:
        namespace, number: together its name.
        kind: ``cylinder`` along its z, ``sphere``, ``box``; ``arrow`` or line (``strip``) through
            ``points``; ``text`` that faces the viewer; ``triangles``, three ``points`` each.
        pose: frame of the shape in the world; identity where ``points`` say all.
        size: m. Diameters and length of a cylinder, diameters of a sphere, edges of a box;
            diameters of shaft and head and length of the head of an arrow; width of a strip;
            height of letters last for a text; ones for triangles.
        colour: red, green, blue and opacity, 0 to 1.
        points: (n, 3) in the world: tail and tip of an arrow, corners of a strip or of triangles.
        text: what a text says.
    """

    namespace: str
    number: int
    kind: Kind
    pose: pin.SE3
    size: tuple[float, float, float]
    colour: Colour
    points: Array = field(default_factory=lambda: np.zeros((0, 3)))
    text: str = ""

    @property
    def key(self) -> Key:
        """Return namespace and number."""
        return self.namespace, self.number

    @property
    def meaning(self) -> str:
        """Return what it means: its namespace without what is behind the first slash."""
        return self.namespace.partition("/")[0]


def numbered(namespace: str, shapes: Iterable[Shape], first: int = 0) -> list[Shape]:
    """Return the shapes under a namespace, numbered from ``first``."""
    return [replace(s, namespace=namespace, number=i) for i, s in enumerate(shapes, first)]


def vanished(before: Iterable[Key], now: Iterable[Shape]) -> list[Key]:
    """Return the keys that were shown before and are no more, in a fixed order."""
    return sorted(set(before) - {shape.key for shape in now})


def cylinder(centre: Array, along: Array, diameter: float, colour: Colour) -> Shape:
    """Return a cylinder about ``centre``; ``along`` (3,) is its axis times its length, m.

    Args:
        centre: (3,) m.
        along: (3,) its axis times its length, m.
        diameter: m.
        colour: of the palette.
    """
    length = float(np.linalg.norm(along))
    pose = pin.SE3(rotation_to(along), np.asarray(centre))
    return Shape("", 0, "cylinder", pose, (diameter, diameter, length), colour)


def capsule(start: Array, end: Array, diameter: float, colour: Colour) -> list[Shape]:
    """Return a cylinder from ``start`` to ``end`` with round ends.

    Args:
        start: (3,) m.
        end: (3,) m.
        diameter: m.
        colour: of the palette.
    """
    ends = [sphere(point, diameter, colour) for point in (start, end)]
    return [cylinder(0.5 * (start + end), end - start, diameter, colour), *ends]


def sphere(centre: Array, diameter: float, colour: Colour) -> Shape:
    """Return a sphere.

    Args:
        centre: (3,) m.
        diameter: m.
        colour: of the palette.
    """
    pose = pin.SE3(np.eye(3), np.asarray(centre))
    return Shape("", 0, "sphere", pose, (diameter,) * 3, colour)


def box(pose: pin.SE3, size: tuple[float, float, float], colour: Colour) -> Shape:
    """Return a box with its edges along the axes of ``pose``."""
    return Shape("", 0, "box", pose, size, colour)


def arrow(tail: Array, tip: Array, shaft: float, colour: Colour) -> list[Shape]:
    """Return an arrow with a shaft of diameter ``shaft``, m; none where it has no length.

    Args:
        tail: (3,) m.
        tip: (3,) m.
        shaft: its diameter, m.
        colour: of the palette.
    """
    length = float(np.linalg.norm(tip - tail))
    if length < _NOTHING:
        return []
    head = min(4.0 * shaft, LONGEST_HEAD * length)
    size = (shaft, 2.5 * shaft, head)
    points = np.array((tail, tip))
    return [Shape("", 0, "arrow", pin.SE3.Identity(), size, colour, points)]


def double_arrow(centre: Array, half: Array, shaft: float, colour: Colour) -> list[Shape]:
    """Return two arrows from ``centre``, along ``half`` (3,), m, and against it.

    Args:
        centre: (3,) m.
        half: (3,) from the centre to a tip, m.
        shaft: its diameter, m.
        colour: of the palette.
    """
    return [
        *arrow(centre, centre + half, shaft, colour),
        *arrow(centre, centre - half, shaft, colour),
    ]


def strip(points: Array, width: float, colour: Colour) -> Shape:
    """Return a line through ``points`` (n, 3).

    Args:
        points: (n, 3) m.
        width: m.
        colour: of the palette.
    """
    return Shape("", 0, "strip", pin.SE3.Identity(), (width, 0.0, 0.0), colour, points)


def ring(
    centre: Array, axis: Array, radius: float, width: float, colour: Colour, sense: bool
) -> list[Shape]:
    """Return a ring about ``axis`` (3,).

    Args:
        centre: (3,) m.
        axis: (3,) normal of its plane, of any length; of length zero: nothing is drawn.
        radius: m.
        width: of the line, m.
        colour: of line and arrowhead.
        sense: leave it open and put an arrowhead on its end, turning right-handed about the axis.
    """
    if np.linalg.norm(axis) < _NOTHING or radius < _NOTHING:
        return []
    turn = 2.0 * np.pi * (1.0 - RING_GAP if sense else 1.0)
    angles = np.linspace(0.0, turn, RING_CORNERS + 1)
    across = rotation_to(axis)[:, :2]
    corners = centre + radius * np.column_stack((np.cos(angles), np.sin(angles))) @ across.T
    shapes = [strip(corners, width, colour)]
    if sense:
        forward = across @ np.array((-np.sin(turn), np.cos(turn)))
        head = min(5.0 * width, radius)
        tip = corners[-1] + head * forward
        size = (0.5 * width, 3.0 * width, 0.98 * head)
        points = np.array((corners[-1], tip))
        shapes.append(Shape("", 0, "arrow", pin.SE3.Identity(), size, colour, points))
    return shapes


def axes(
    pose: pin.SE3, length: float, shaft: float, colours: tuple[Colour, Colour, Colour]
) -> list[Shape]:
    """Return cylinders from the origin of ``pose`` along its x, y and z."""
    ends = [length * pose.rotation[:, i] for i in range(3)]
    return [
        cylinder(pose.translation + 0.5 * end, end, shaft, colour)
        for end, colour in zip(ends, colours, strict=True)
    ]


def text(place: Array, words: str, height: float, colour: Colour) -> Shape:
    """Return words that face the viewer, ``height`` m high.

    Args:
        place: (3,) m.
        words: the text.
        height: m.
        colour: of the palette.
    """
    pose = pin.SE3(np.eye(3), np.asarray(place))
    return Shape("", 0, "text", pose, (0.0, 0.0, height), colour, text=words)


def rotation_to(direction: Array) -> Array:
    """Return a rotation (3, 3) whose z is along ``direction`` (3,); identity where it has none.

    Args:
        direction: (3,).
    """
    length = float(np.linalg.norm(direction))
    if length < _NOTHING:
        return np.eye(3)
    z = direction / length
    # The world's axis that is least along z makes a right angle with it most safely.
    helper = np.eye(3)[int(np.argmin(np.abs(z)))]
    x = np.cross(helper, z)
    x /= np.linalg.norm(x)
    return np.column_stack((x, np.cross(z, x), z))
