# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Wrenches and directions as shapes: forces are arrows, torques are rings about their axis."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from hapticmech_ros.arrays import Array
from hapticmech_ros.view.directions import Direction
from hapticmech_ros.view.shapes import Shape, arrow, double_arrow, numbered, ring
from hapticmech_ros.view.user_look import PLAIN, Look

# Sizes as shares of the mechanism's characteristic length.
FORCE_SHAFT = 0.045
RIGID_SHAFT = 0.03
FREE_SHAFT = 0.012
DIRECTION_LENGTH = 0.6
RING_RADIUS = 0.4
# What would be drawn shorter than this is not drawn.
SMALLEST = 0.01
TORQUE = "/torque"


@dataclass(frozen=True, slots=True)
class Scales:
    """How long a wrench is drawn.

    Attributes:
        unit: the mechanism's characteristic length, m, for widths.
        force: length of an arrow, m per N.
        torque: radius of a ring, m per N m.
    """

    unit: float
    force: float
    torque: float


def wrench_shapes(
    meaning: str, number: int, place: Array, wrench: Array, scales: Scales, look: Look = PLAIN
) -> list[Shape]:
    """Return an arrow and a ring for a wrench (6,) at ``place`` (3,), tail and centre there.

    Of several wrenches in a namespace each has its number.

    Args:
        meaning: of the wrench, by which it is named and coloured.
        number: of this wrench in the namespace.
        place: (3,) m, world axes.
        wrench: (6,) N and N m, world axes.
        scales: characteristic length (m), m/N and m/(N m).
        look: of the user whose it is.
    """
    namespace, colour = look.namespace(meaning), look.colour(meaning)
    width = FORCE_SHAFT * scales.unit
    force, radius = scales.force * wrench[:3], scales.torque * float(np.linalg.norm(wrench[3:]))
    shapes: list[Shape] = []
    if np.linalg.norm(force) > SMALLEST * scales.unit:
        found = arrow(place, place + force, width, colour)
        shapes += numbered(namespace, found, first=number)
    if radius > SMALLEST * scales.unit:
        found = ring(place, wrench[3:], radius, 0.4 * width, colour, sense=True)
        shapes += numbered(namespace + TORQUE, found, first=2 * number)
    return shapes


def direction_shapes(
    meaning: str, found: Sequence[Direction], place: Array, unit: float, look: Look = PLAIN
) -> list[Shape]:
    """Return a double-headed arrow and a ring for every direction at ``place`` (3,).

    A direction has no sense, so a ring has no head. The longest arrow has ``DIRECTION_LENGTH`` to
    either side, the largest ring ``RING_RADIUS``, as shares of ``unit`` (m).

    Args:
        meaning: ``rigid_directions`` or ``free_directions``.
        found: the directions.
        place: (3,) m, world axes.
        unit: the mechanism's characteristic length, m.
        look: of the user who feels them.
    """
    namespace, colour = look.namespace(meaning), look.colour(meaning)
    shaft = (RIGID_SHAFT if meaning == "rigid_directions" else FREE_SHAFT) * unit
    shapes: list[Shape] = []
    for index, direction in enumerate(found):
        half = DIRECTION_LENGTH * unit * direction.force
        if np.linalg.norm(half) > SMALLEST * unit:
            arrows = double_arrow(place, half, shaft, colour)
            shapes += numbered(namespace, arrows, first=2 * index)
        radius = RING_RADIUS * unit * float(np.linalg.norm(direction.torque))
        if radius > SMALLEST * unit:
            circle = ring(place, direction.torque, radius, 0.5 * shaft, colour, sense=False)
            shapes += numbered(namespace + TORQUE, circle, first=index)
    return shapes
