# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Hulls of points: flat faces whole, whatever triangles they come in."""

from itertools import pairwise

import numpy as np
import pytest

from hapticmech_ros.contact.hull import box, hull, read_mesh
from hapticmech_ros.contact.mesh_corners import MOST_VERTICES
from hapticmech_ros.errors import SceneError


def ball(count):
    points = np.random.default_rng(0).normal(size=(count, 3))
    return points / np.linalg.norm(points, axis=1)[:, None]


def grid():
    """Return points all over a box and in it: faces of many triangles."""
    return np.random.default_rng(1).integers(0, 5, size=(600, 3)) * np.array([0.1, 0.2, 0.3])


@pytest.mark.parametrize("points", [ball(300), grid(), box((1.0, 2.0, 3.0)).vertices])
def test_faces_are_flat_and_whole(points):
    found = hull(points)
    edges = {}
    for corners, normal in zip(found.faces, found.normals, strict=True):
        heights = found.vertices @ normal
        # All corners of a face are as high as anything gets along its normal.
        assert np.ptp(heights[list(corners)]) < 1e-12
        assert heights.max() < heights[list(corners)].max() + 1e-12
        around = np.array([found.vertices[c] for c in corners])
        area = sum(np.cross(a - around[0], b - around[0]) for a, b in pairwise(around[1:]))
        assert area @ normal > 0.0
        for start, end in zip(corners, corners[1:] + corners[:1], strict=True):
            edges[start, end] = edges.get((start, end), 0) + 1
    # A closed surface: each edge once in each direction; and Euler's count.
    assert set(edges.values()) == {1}
    assert all((end, start) in edges for start, end in edges)
    corners = {corner for face in found.faces for corner in face}
    assert len(corners) - len(edges) // 2 + len(found.faces) == 2
    assert len({tuple(np.round(normal, 6)) for normal in found.normals}) == len(found.faces)


def test_a_mesh_of_too_many_corners_is_refused(tmp_path):
    path = tmp_path / "ball.obj"
    points = ball(MOST_VERTICES + 1)
    lines = [f"v {x} {y} {z}" for x, y, z in points]
    # Every corner belongs to some triangle, or the reader leaves it out.
    lines += [f"f {i} {i + 1} {i + 2}" for i in range(1, len(points) - 1)]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    with pytest.raises(SceneError, match=f"at most {MOST_VERTICES} corners"):
        read_mesh(str(path), (1.0, 1.0, 1.0), "shapes[0].geometry.file")
