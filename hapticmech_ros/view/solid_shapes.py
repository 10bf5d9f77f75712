# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What may touch, and springs between points, as shapes."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from hapticmech_ros.arrays import Array
from hapticmech_ros.scene import Scene
from hapticmech_ros.scene.contacts import Box, Capsule, Cylinder, Geometry, HalfSpace, Sphere
from hapticmech_ros.view import palette
from hapticmech_ros.view.placement import Placement
from hapticmech_ros.view.shapes import (
    Shape,
    box,
    capsule,
    cylinder,
    numbered,
    rotation_to,
    sphere,
    strip,
)

# As shares of the mechanism's length: a half-space is drawn as a plate below its plane.
PLATE_SIDE, PLATE_THICKNESS = 1.2, 0.06
SPRING_WIDTH, COIL_RADIUS = 0.02, 0.05
COILS = 6


def solid_shapes(scene: Scene, placement: Placement, unit: float) -> list[Shape]:
    """Return every shape that may touch; of meshes none."""
    shapes: list[Shape] = []
    for shape, pose in zip(scene.shapes, placement.solids, strict=True):
        shapes += _solid(shape.geometry, pose, unit)
    return numbered("solids", shapes)


def spring_shapes(placement: Placement, unit: float) -> list[Shape]:
    """Return a line with as many coils, however long it is, for every spring between points."""
    coils = [_coils(ends, COIL_RADIUS * unit) for ends in placement.springs]
    return numbered("springs", [strip(c, SPRING_WIDTH * unit, palette.SPRING) for c in coils])


def _solid(geometry: Geometry, pose: pin.SE3, unit: float) -> list[Shape]:
    centre, along = pose.translation, pose.rotation[:, 2]
    if isinstance(geometry, Sphere):
        return [sphere(centre, 2.0 * geometry.radius, palette.SOLID)]
    if isinstance(geometry, Box):
        return [box(pose, geometry.size, palette.SOLID)]
    if isinstance(geometry, Cylinder):
        return [cylinder(centre, geometry.length * along, 2.0 * geometry.radius, palette.SOLID)]
    if isinstance(geometry, Capsule):
        half = 0.5 * geometry.length * along
        return capsule(centre - half, centre + half, 2.0 * geometry.radius, palette.SOLID)
    if isinstance(geometry, HalfSpace):
        side, thick = PLATE_SIDE * unit, PLATE_THICKNESS * unit
        below = pose * pin.SE3(np.eye(3), np.array((0.0, 0.0, -0.5 * thick)))
        return [box(below, (side, side, thick), palette.SOLID)]
    return []


def _coils(ends: Array, radius: float) -> Array:
    """Return corners (n, 3) of a zigzag between two points, straight at its ends."""
    shares = np.linspace(0.15, 0.85, 2 * COILS + 1)
    across = np.where(np.arange(shares.size) % 2 == 0, 1.0, -1.0) * radius
    across[0] = across[-1] = 0.0
    start, end = ends
    sides = rotation_to(end - start)[:, :2]
    aside = sides[:, int(np.argmin(np.abs(sides[2])))]  # in the plane, of a planar scene
    turns = start + shares[:, None] * (end - start) + across[:, None] * aside
    return np.vstack((start, turns, end))
