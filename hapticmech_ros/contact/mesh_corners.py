# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Finds corners of the convex hull of a mesh in a file, or its triangles, to be drawn.

It runs in the child process that reads the file.

It loads little, as each start of a node with meshes waits for it.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import coal
import numpy as np
from scipy.spatial import ConvexHull, QhullError

MOST_VERTICES = 2000
# Of a mesh that is drawn, for browsers without a GPU. A larger one is made coarser: its corners are
# joined in cells, so many along its longest side. Of one that is too large for that, the hull.
MOST_TRIANGLES, MOST_JOINED = 20_000, 200_000
CELLS = 40


def corners_of(item: Mapping[str, Any]) -> dict[str, Any]:
    """Return the corners of a file's hull, or the rule that the file breaks; runs in the child."""
    try:
        points = np.unique(_load(item)[0], axis=0)
    except ValueError as error:
        return {"rule": f"cannot be read as a mesh: {error}"}
    try:
        corners = ConvexHull(points).vertices
    except (QhullError, ValueError, IndexError):
        return {"rule": "the mesh must not be flat"}
    if len(corners) > MOST_VERTICES:
        rule = f"the hull must have at most {MOST_VERTICES} corners, not {len(corners)}"
        return {"rule": rule}
    return {"corners": points[corners].tolist()}


def surface_of(item: Mapping[str, Any]) -> dict[str, Any]:
    """Return the corners and triangles of a file's mesh, or of a coarser one, or of its hull."""
    try:
        vertices, loaded = _load(item)
    except ValueError as error:
        return {"rule": f"cannot be read as a mesh: {error}"}
    if not 0 < loaded.num_tris <= MOST_JOINED:
        return corners_of(item)
    triangles = [
        [one[0], one[1], one[2]] for one in map(loaded.tri_indices, range(loaded.num_tris))
    ]
    corners, places = np.unique(vertices.astype(np.float32), axis=0, return_inverse=True)
    found = places.ravel()[np.array(triangles, dtype=int)]
    if len(found) > MOST_TRIANGLES:
        corners, found = _joined(corners, found)
    if not 0 < len(found) <= MOST_TRIANGLES:
        return corners_of(item)
    return {"corners": corners.tolist(), "triangles": found.tolist()}


def _joined(corners: np.ndarray, triangles: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return a mesh of the mean corner in each cell of a grid, without triangles in one or two."""
    low = corners.min(axis=0)
    cells = np.floor((corners - low) * (CELLS / np.ptp(corners, axis=0).max()))
    _, places, counts = np.unique(cells, axis=0, return_inverse=True, return_counts=True)
    places = places.ravel()
    means = np.zeros((len(counts), 3))
    np.add.at(means, places, corners)
    left = places[triangles]
    whole = (left != np.roll(left, 1, axis=1)).all(axis=1)
    _, first = np.unique(np.sort(left[whole], axis=1), axis=0, return_index=True)
    return (means / counts[:, None]).astype(np.float32), left[whole][np.sort(first)]


def _load(item: Mapping[str, Any]) -> tuple[np.ndarray, Any]:
    """Return a file's vertices (n, 3), and what the library has of it.

    Raises:
        ValueError: it cannot be read, or a vertex is not finite.
    """
    try:
        loaded = coal.MeshLoader().load(item["file"], np.array(item["scale"]))
    except (RuntimeError, ValueError) as error:
        reason = " ".join(str(error).partition("message:")[2].split()) or str(error)
        raise ValueError(reason) from None
    vertices = np.array(loaded.vertices())
    if not np.isfinite(vertices).all():
        raise ValueError("a vertex is not finite")
    return vertices, loaded
