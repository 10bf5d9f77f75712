# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Hulls in the picture: where they are, how large; and the forces at points of contact."""

from __future__ import annotations

import numpy as np
import pytest

from hapticmech_ros.contact.hull import hull
from hapticmech_ros.mechanism import Mechanism
from hapticmech_ros.nodes.viewer.scene_viewer import marker_of
from hapticmech_ros.scene import scene_from_document
from hapticmech_ros.view import Placer, palette
from hapticmech_ros.view.shapes import Hulls, Scales, touch_shapes
from hapticmech_ros.wire.contact_points import ContactPoints
from oracles.touching import FLOOR, SHAPES, body, pair, scene, shape

CUBE = 0.05 * np.array([(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
TURNED = [0.3, -0.2, 0.5, *(np.array([0.1, 0.4, -0.2, 0.8]) / np.sqrt(0.85))]


def drawn(geometry, q):
    """Return the hulls of one body above a floor, and the body's pose."""
    document = scene(
        [body("one")], [FLOOR, shape("one", geometry)], [pair("one_shape")], {"one": q}
    )
    mechanism = Mechanism(scene_from_document(document))
    placement = Placer(mechanism).at(np.array(q))
    return Hulls(mechanism.scene).draw(placement), placement.links["one"]


def test_a_mesh_is_drawn_as_its_hull(tmp_path):
    rows = [f"v {x} {y} {z}" for x, y, z in [*CUBE.tolist(), (0.0, 0.0, 0.0)]]
    faces = [f"f {a + 1} {b + 1} {c + 1}" for a, b, c in hull(CUBE).triangles.tolist()]
    file = tmp_path / "cube.obj"
    file.write_text("\n".join([*rows, *faces, "f 1 2 9"]) + "\n", encoding="utf-8")
    found, pose = drawn({"kind": "mesh", "file": str(file)}, TURNED)
    (mesh,) = found
    assert (mesh.key, mesh.kind) == (("hulls", 1), "triangles")
    corners = mesh.points.reshape(-1, 3, 3)
    assert len(corners) == 12
    local = (mesh.points - pose.translation) @ pose.rotation
    assert np.abs(local) == pytest.approx(np.full(local.shape, 0.05), abs=1e-9)
    # Seen from outside each triangle turns left.
    out = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    assert ((out * (corners.mean(axis=1) - pose.translation)).sum(axis=1) > 0.0).all()
    marker = marker_of(mesh)
    assert (marker.type, len(marker.points)) == (marker.TRIANGLE_LIST, 36)
    assert (marker.scale.x, marker.scale.y, marker.scale.z) == (1.0, 1.0, 1.0)


def test_forces_are_arrows_from_their_points():
    points = np.array([(0.1, 0.2, 0.0), (0.3, 0.0, 0.0), (0.0, 0.0, 0.4)])
    forces = np.array([(0.0, 0.0, 5.0), (0.0, 0.0, 0.0), (2.0, 0.0, 0.0)])
    told = ContactPoints(0, np.arange(3), points, forces, np.zeros(3), forces)
    found = touch_shapes(told, Scales(0.1, 0.05, 1.0))
    # What pushes with nothing is not drawn, and the others keep their numbers.
    assert [part.key for part in found] == [("touch_force", 0), ("touch_force", 2)]
    for part, index in zip(found, (0, 2), strict=True):
        assert part.points[0] == pytest.approx(points[index])
        assert part.points[1] - part.points[0] == pytest.approx(0.05 * forces[index])
        assert part.colour == palette.MEANING["touch_force"]


def test_what_is_no_mesh_has_no_hull_of_its_own():
    assert drawn(SHAPES["box"], TURNED)[0] == []
