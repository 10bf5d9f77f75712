# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Wrenches and directions as shapes: forces are arrows, torques are rings about their axis.

Columns n_i of the spectrum are unique only where their μ are: any rotation among equal ones will
do, and which one comes out changes from sample to sample. Drawn as they come they would flicker, so
they are turned first: forces are gathered into as few columns as possible.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from hapticmech_ros.arrays import Array
from hapticmech_ros.errors import InvalidInputError
from hapticmech_ros.operational import OperationalAnalysis
from hapticmech_ros.scene import Scene
from hapticmech_ros.scene.contacts import Mesh
from hapticmech_ros.view import palette
from hapticmech_ros.view.placement import Placement
from hapticmech_ros.view.shapes import Shape, arrow, double_arrow, numbered, ring
from hapticmech_ros.view.user_look import PLAIN, Look
from hapticmech_ros.wire.contact_points import ContactPoints


class Direction(NamedTuple):
    """A wrench as shares of the largest ones of unit length in the metric; axes of the world.

    Attributes:
        force: (3,) of length 0 to 1.
        torque: (3,) of length 0 to 1.
    """

    force: Array
    torque: Array


def directions(
    analysis: OperationalAnalysis, count: int
) -> tuple[list[Direction], list[Direction]]:
    """Return rigid directions, ``count`` of them, and free ones: all the others.

    Raises:
        InvalidInputError: count is negative, or more than there are directions.
    """
    wrenches = np.zeros((6, analysis.rows.size))
    wrenches[analysis.rows] = analysis.spectrum.wrenches
    size = wrenches.shape[1]
    if not 0 <= count <= size:
        raise InvalidInputError("count", count, f"must be 0 to {size}")
    # I_ℓ is the sum of all n_i n_iᵀ, so the largest force and torque of a unit wrench are these.
    metric = wrenches @ wrenches.T
    largest_force = np.sqrt(np.linalg.eigvalsh(metric[:3, :3])[-1])
    largest_torque = np.sqrt(np.linalg.eigvalsh(metric[3:, 3:])[-1])
    parts = []
    for columns in (wrenches[:, size - count :], wrenches[:, : size - count]):
        turned = gathered(columns)
        parts.append([Direction(n[:3] / largest_force, n[3:] / largest_torque) for n in turned.T])
    return parts[0], parts[1]


def gathered(columns: Array) -> Array:
    """Return ``columns`` (6, k) turned among themselves, those of the largest force first.

    The forces of the result are perpendicular to each other, and the span is the same.

    Args:
        columns: (6, k) wrenches, forces first, world axes, in any unit.
    """
    if columns.shape[1] < 2:
        return columns
    _, _, turn = np.linalg.svd(columns[:3])
    return np.asarray(columns @ turn.T)


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


HULLS, FORCES = "hulls", "touch_force"


class Hulls:
    """Draws the convex hulls of a scene's meshes.

    Args:
        scene: that has them, or none.

    Raises:
        SceneError: a mesh that cannot be read.
    """

    def __init__(self, scene: Scene) -> None:
        self._corners: list[tuple[int, Array]] = []
        if any(isinstance(shape.geometry, Mesh) for shape in scene.shapes):
            # Here, so that scenes without meshes do not load what reads them.
            from hapticmech_ros.contact.mesh_hulls import mesh_hulls

            for index, hull in mesh_hulls(scene.shapes).items():
                self._corners.append((index, hull.vertices[hull.triangles.ravel()]))

    def draw(self, placement: Placement) -> list[Shape]:
        """Return every hull where its link is; its number is that of the scene's shape."""
        return [self._hull(i, corners, placement.solids[i]) for i, corners in self._corners]

    def _hull(self, index: int, corners: Array, pose: pin.SE3) -> Shape:
        points = corners @ pose.rotation.T + pose.translation
        colour, size = palette.MEANING[HULLS], (1.0, 1.0, 1.0)
        return Shape(HULLS, index, "triangles", pin.SE3.Identity(), size, colour, points)


def touch_shapes(found: ContactPoints, scales: Scales) -> list[Shape]:
    """Return the force on shape a at each point of contact, as an arrow from there."""
    shapes: list[Shape] = []
    for number, (place, force) in enumerate(zip(found.points, found.forces, strict=True)):
        shapes += wrench_shapes(FORCES, number, place, np.append(force, np.zeros(3)), scales)
    return shapes
