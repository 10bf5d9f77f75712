# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A mechanism that touches things says where, and what each pair does, to those who listen."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from visualization_msgs.msg import Marker

from benchmarks.reliability.fake_graph import FakeGraph
from hapticmech_ros.nodes.mechanism_simulator import MechanismSimulator
from hapticmech_ros.nodes.viewer.scene_viewer import SceneViewer
from hapticmech_ros.wire.contact_points import ContactLayout
from nodes.stand_ins import heard
from oracles.touching import FLOOR, SHAPES, UPRIGHT, G, body, pair, scene, shape
from ros.harness import six

LAW = {"stiffness": 1e4, "damping": 300.0, "friction": 0.5}
PAIRS = ("one_shape_floor", "two_shape_floor")


@pytest.fixture
def scene_file(tmp_path: Path) -> str:
    """Two boxes: one at rest on the floor, the other 1 m beside it, and far above."""
    names = ("one", "two")
    document = scene(
        [body(name) for name in names],
        [FLOOR, *(shape(name, SHAPES["box"]) for name in names)],
        [pair(f"{name}_shape", **LAW) for name in names],
        {"one": [0.2, 0.1, 0.05 - G / 4e4, *UPRIGHT], "two": [1.2, 0.0, 1e6, *UPRIGHT]},
    )
    file = tmp_path / "touching.yaml"
    file.write_text(json.dumps(document), encoding="utf-8")
    return str(file)


def test_every_point_and_every_pair_is_published(scene_file: str) -> None:
    graph = FakeGraph(scene_file, actors=[MechanismSimulator])
    topics = [f"/mechanism/contacts/{name}/measured_cf" for name in PAIRS]
    told = "/mechanism/contacts", "/mechanism/held/measured_cp", *topics
    points, poses, *wrenches = heard(graph, *told)
    graph.run(0.1)
    layout = ContactLayout(PAIRS)
    found = layout.unpack(np.array(points[-1].data))
    assert points[-1].layout.dim[0].label == "stamp:2,points/one_shape_floor/two_shape_floor:44"
    assert found.pairs.tolist() == [0] * 4
    assert found.normals == pytest.approx(np.tile([0.0, 0.0, 1.0], (4, 1)), abs=1e-9)
    corners = np.abs(found.points - [0.2, 0.1, 0.0])
    assert corners[:, :2] == pytest.approx(np.full((4, 2), 0.05), abs=1e-6)
    assert found.depths == pytest.approx(np.full(4, G / 4e4), abs=1e-6)
    assert found.forces.sum(axis=0) == pytest.approx([0.0, 0.0, G], abs=1e-3)
    # The pair's wrench: by the floor, on the box, at the box's middle; the other pair has none.
    assert wrenches[0][-1].header.frame_id == "world"
    assert six(wrenches[0][-1]) == pytest.approx([0, 0, G, 0, 0, 0], abs=1e-3)
    assert six(wrenches[1][-1]) == [0.0] * 6
    position = poses[-1].pose.position
    assert (position.x, position.y) == pytest.approx((0.2, 0.1), abs=1e-6)
    stamps = [layout.unpack(np.array(message.data)).stamp_ns for message in points]
    assert (np.diff(stamps) > 0).all()


def test_the_viewer_draws_objects_and_the_forces_between_them(scene_file: str) -> None:
    graph = FakeGraph(scene_file, actors=[MechanismSimulator, SceneViewer])
    graph.run(0.2)

    def places(namespace: str) -> list[Marker]:
        drawn = graph.last["/view/markers"].markers
        return [m for m in drawn if m.ns == namespace and m.action == Marker.ADD]

    assert len(places("touch_force")) == 4
    floor, one, two = places("solids")
    assert floor.scale.x > floor.scale.z
    assert (one.scale.x, one.scale.y, one.scale.z) == pytest.approx((0.1, 0.1, 0.1))
    assert (one.pose.position.x, one.pose.position.y) == pytest.approx((0.2, 0.1), abs=1e-6)
    assert two.pose.position.z > 1e5
    for marker in places("touch_force"):
        tail, tip = marker.points
        assert (tail.x, tail.y) == pytest.approx((tip.x, tip.y), abs=1e-3)
        assert tip.z > tail.z
