# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Convex polytopes: vertices and flat faces, of boxes and of hulls of points."""

from __future__ import annotations

from itertools import product
from typing import NamedTuple

import numpy as np
from scipy.spatial import ConvexHull

from hapticmech_ros.arrays import Array

# Triangles whose normals differ by less are one face.
FLAT = 1e-6


class Polytope(NamedTuple):
    """A convex body.

    Attributes:
        vertices: (n, 3) m.
        faces: indices of the corners of each, in order around its outward normal.
        normals: (f, 3) outward unit normals.
        triangles: (t, 3) indices of corners, in order around the outward normal.
    """

    vertices: Array
    faces: tuple[tuple[int, ...], ...]
    normals: Array
    triangles: Array


def box(size: tuple[float, float, float]) -> Polytope:
    """Return a box about the origin, lengths in m."""
    return hull(np.array(list(product((-0.5, 0.5), repeat=3))) * np.array(size))


def hull(points: Array) -> Polytope:
    """Return the convex hull of points, in their axes.

    Args:
        points: (n, 3) m.

    Raises:
        QhullError: all of them are in one plane.
    """
    found = ConvexHull(points)
    kept = np.sort(found.vertices)
    place = {int(old): new for new, old in enumerate(kept)}
    vertices = np.ascontiguousarray(points[kept], dtype=float)
    triangles = [[place[int(corner)] for corner in simplex] for simplex in found.simplices]
    merged = _merged(found, place)
    normals = np.array([_unit(normal) for normal, _ in merged])
    faces = tuple(_around(vertices, members, normal) for normal, members in merged)
    outwards = [
        _turned(vertices, corners, normal)
        for corners, normal in zip(triangles, found.equations[:, :3], strict=True)
    ]
    return Polytope(vertices, faces, normals, np.array(outwards))


def _merged(found: ConvexHull, place: dict[int, int]) -> list[tuple[Array, set[int]]]:
    """Return normals and corners of faces: triangles beside each other with one normal are one."""
    normals = found.equations[:, :3]
    seen = np.zeros(len(normals), dtype=bool)
    faces: list[tuple[Array, set[int]]] = []
    for first in range(len(normals)):
        if seen[first]:
            continue
        seen[first] = True
        members: set[int] = set()
        waiting = [first]
        while waiting:
            one = waiting.pop()
            members |= {place[int(corner)] for corner in found.simplices[one]}
            for other in found.neighbors[one].tolist():
                if not seen[other] and np.linalg.norm(normals[other] - normals[first]) < FLAT:
                    seen[other] = True
                    waiting.append(other)
        faces.append((normals[first], members))
    return faces


def _around(vertices: Array, members: set[int], normal: Array) -> tuple[int, ...]:
    """Return corners of a face in order around its normal, beginning with the first."""
    corners = sorted(members)
    middle = vertices[corners].mean(axis=0)
    first = vertices[corners[0]] - middle
    second = np.cross(normal, first)
    away = vertices[corners] - middle
    angles = np.arctan2(away @ second, away @ first)
    order = sorted(range(len(corners)), key=lambda k: float(angles[k]) % (2.0 * np.pi))
    return tuple(corners[k] for k in order)


def _turned(vertices: Array, corners: list[int], normal: Array) -> list[int]:
    """Return a triangle whose corners go around its outward normal."""
    a, b, c = vertices[corners]
    return corners if np.cross(b - a, c - a) @ normal > 0.0 else corners[::-1]


def _unit(vector: Array) -> Array:
    return np.asarray(vector / np.linalg.norm(vector))
