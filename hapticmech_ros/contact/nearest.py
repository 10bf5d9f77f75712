# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Nearest points of two bounded shapes, by coal (GJK and EPA).

The only file that makes coal's objects.
"""

from __future__ import annotations

import coal
import numpy as np

from hapticmech_ros.contact.hull import Polytope
from hapticmech_ros.contact.layout import FOUND_VALUES
from hapticmech_ros.numerics import Array
from hapticmech_ros.scene.contacts import Box, Capsule, Cylinder, Shape, Sphere

TOLERANCE = 1e-9


class Nearest:
    """Searches for the nearest points of one pair of shapes.

    Args:
        a, b: the shapes; neither is a half-space.
        polytopes: of each, None where it is none.
    """

    def __init__(self, a: Shape, b: Shape, polytopes: tuple[Polytope | None, ...]) -> None:
        self._shapes = tuple(
            _geometry(shape, polytope) for shape, polytope in zip((a, b), polytopes, strict=True)
        )
        self._search = coal.ComputeDistance(*self._shapes)
        self._request = coal.DistanceRequest()
        self._request.enable_signed_distance = True
        self._request.gjk_tolerance = self._request.epa_tolerance = TOLERANCE
        self._result = coal.DistanceResult()
        self._places = coal.Transform3s(), coal.Transform3s()
        self.found = np.zeros(FOUND_VALUES)

    def search(self, pose_a: Array, pose_b: Array) -> Array:
        """Return (10,): unit normal from a to b, distance (below 0 if they overlap), points.

        Points are the nearest one of a, then of b; m, world axes. It is the same array each time.

        Args:
            pose_a: (12,) axes and origin of a, m, in the world.
            pose_b: (12,) likewise, of shape b.
        """
        for place, pose in zip(self._places, (pose_a, pose_b), strict=True):
            place.setTransform(pose[:9].reshape(3, 3).T, pose[9:])
        result, found = self._result, self.found
        result.clear()
        found[3] = self._search(*self._places, self._request, result)
        found[:3] = result.normal
        found[4:7] = result.getNearestPoint1()
        found[7:] = result.getNearestPoint2()
        return found


def _geometry(shape: Shape, polytope: Polytope | None) -> coal.CollisionGeometry:
    match shape.geometry:
        case Sphere(radius=radius):
            return coal.Sphere(radius)
        case Capsule(radius=radius, length=length):
            return coal.Capsule(radius, length)
        case Cylinder(radius=radius, length=length):
            return coal.Cylinder(radius, length)
        case Box(size=size):
            return coal.Box(*size)
    points, triangles = coal.StdVec_Vec3s(), coal.StdVec_Triangle()
    if polytope is not None:
        for vertex in polytope.vertices:
            points.append(vertex)
        for corners in polytope.triangles.tolist():
            triangles.append(coal.Triangle(*corners))
    return coal.Convex(points, triangles)
