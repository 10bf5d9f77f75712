# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What only the viewer draws of contacts: hulls of meshes, and the force at each point."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from hapticmech_ros.arrays import Array
from hapticmech_ros.scene import Scene
from hapticmech_ros.scene.contacts import Mesh
from hapticmech_ros.view import palette
from hapticmech_ros.view.placement import Placement
from hapticmech_ros.view.shapes import Shape
from hapticmech_ros.view.wrench_shapes import Scales, wrench_shapes
from hapticmech_ros.wire.contact_points import ContactPoints

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
