# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The viewer without the other nodes: it draws what it hears, and drops what is over or bad."""

from __future__ import annotations

from xml.etree import ElementTree

import numpy as np
import pytest
from geometry_msgs.msg import PoseStamped
from rclpy.serialization import serialize_message
from std_msgs.msg import UInt8
from visualization_msgs.msg import Marker

from benchmarks.reliability.fake_graph import FakeGraph
from hapticmech_ros import Mechanism, load_scene
from hapticmech_ros.errors import HapticMechError
from hapticmech_ros.mechanism.closures import flat_grasps
from hapticmech_ros.mechanism.projection import consistent_initial_state
from hapticmech_ros.nodes.viewer.scene_viewer import SceneViewer
from hapticmech_ros.view import Placer
from hapticmech_ros.wire.cdr import FlatArray
from hapticmech_ros.wire.state import StateLayout, WireState
from nodes.stand_ins import heard, push, say
from oracles.users import five_bar_of_two
from ros.harness import six

CONTACT = np.array([0.4, -0.2, 0.0, 0.0, 0.0, 0.005])
FELT = [1.0, 2.0, 3.0, 4.0, 5.0, 6.0]
Q, _ = consistent_initial_state(Mechanism(load_scene("five_bar")))
V = np.array((0.1, -0.2, 0.3, -0.4))


class Stage:
    """A viewer, to whom a mechanism tells its state before each picture."""

    def __init__(self, scene="five_bar", namespace="", **parameters):
        given = {"scene_viewer": {"input_timeout": 0.3, **parameters}}
        self.graph = FakeGraph(scene, actors=[SceneViewer], parameters=given, namespace=namespace)
        self.host, self.namespace = self.graph.hosts["scene_viewer"], namespace
        (self.pictures,) = self.heard("view/markers")
        self.mechanism = Mechanism(load_scene(scene))
        # It listens from when it has found that somebody looks.
        self.graph.run(0.1)

    def heard(self, *topics):
        return heard(self.graph, *(f"{self.namespace}/{topic}" for topic in topics))

    def pose(self, topic, x, w=1.0):
        message = PoseStamped()
        message.pose.position.x, message.pose.position.y = x, 0.1
        message.pose.orientation.w = w
        say(self.graph, f"{self.namespace}/{topic}", message)

    def count(self, topic, number):
        self.graph.put(f"{self.namespace}/{topic}", serialize_message(UInt8(data=number)))

    def seen(self, closed=True, seconds=0.1):
        """Let time go on, with a state at its end; return what is drawn then, by namespace."""
        self.graph.run(seconds)
        points = len(self.mechanism.point_names)
        told = WireState(
            self.graph.now_ns,
            (closed,),
            *(Q, V, np.tile(CONTACT, (points, 1)), flat_grasps(self.mechanism.scene)),
            (True,) * points,
        )
        layout = StateLayout(self.mechanism)
        message = FlatArray(layout.fields).encode(layout.pack(told))
        self.graph.put(f"{self.namespace}/mechanism/state", message)
        self.graph.run(0.1)
        drawn = [one for one in self.pictures[-1].markers if one.action == Marker.ADD]
        return {one.ns: one for one in reversed(drawn)}

    def gone(self):
        """Return the namespaces of which something was taken away."""
        markers = [one for picture in self.pictures for one in picture.markers]
        return {one.ns for one in markers if one.action == Marker.DELETE}


def test_the_picture_has_what_is_heard_and_loses_what_is_over():
    stage = Stage()
    seen = stage.seen()
    assert stage.pictures[0].markers[0].action == Marker.DELETEALL
    mechanism = {"links", "joints", "closures", "point/handle", "point/handle_world"}
    assert mechanism | {"contact_force"} <= seen.keys()
    assert not {"device", "hand_force"} & seen.keys()
    tail, tip = seen["contact_force"].points
    place = Placer(stage.mechanism).at(Q).points["handle"].translation
    assert [tail.x, tail.y] == pytest.approx(place[:2], abs=1e-12)
    assert [tip.x - tail.x, tip.y - tail.y] == pytest.approx(0.05 * CONTACT[:2], abs=1e-12)
    stage.pose("device/measured_cp", 0.2)
    for topic in ("device/hand/measured_cf", "device/servo_cf", "mechanism/handle/servo_cf"):
        push(stage.graph, f"/{topic}", [0.5] * 6)
    stage.count("analysis/handle/constraint_count", 2)
    seen = stage.seen()
    wanted = {"device", "hand_force", "device_command", "point_command", "rigid_directions"}
    assert wanted <= seen.keys()
    assert seen["count"].text == "2 joint constraints"
    seen = stage.seen(closed=False, seconds=0.4)
    assert "open_closures" in seen
    assert not {"hand_force", "closures"} & seen.keys()
    assert {"hand_force", "closures"} <= stage.gone()


def test_bad_messages_are_refused_and_the_rest_is_drawn():
    stage = Stage()
    bad = FlatArray({"numbers": 18}).encode(np.full(18, 0.5))
    for number, (topic, tell) in enumerate(
        (
            ("mechanism/state", lambda: stage.graph.put("/mechanism/state", bad)),
            ("constraint_count", lambda: stage.count("analysis/handle/constraint_count", 200)),
            ("device/measured_cp", lambda: stage.pose("device/measured_cp", 0.1, w=0.5)),
        ),
        1,
    ):
        tell()
        seen = stage.seen()
        assert stage.host.refused == number
        assert topic in stage.host.last_refusal
        assert "links" in seen
    assert "device" not in seen


def test_model_joints_frames_and_wrenches():
    """Two graphs do not place each other's links: frames have a namespace before them."""
    stage = Stage(namespace="/left")
    joints, frames, forces, felt = stage.heard(
        "joint_states", "view/frames", "view/handle/measured_cf", "view/device/servo_cf"
    )
    stage.pose("device/measured_cp", 0.2)
    push(stage.graph, "/left/device/servo_cf", FELT)
    stage.seen()
    robot = ElementTree.fromstring(stage.graph.last["/left/robot_description"].data.encode())
    moving = {j.get("name") for j in robot.findall("joint") if j.get("type") != "fixed"}
    assert set(joints[-1].name) == moving
    assert list(joints[-1].position) == pytest.approx(Q, abs=1e-12)
    assert list(joints[-1].velocity) == pytest.approx(V, abs=1e-12)
    parents = {frame.child_frame_id: frame.header.frame_id for frame in frames}
    names = ("link1", "link2", "link3", "link4", "handle", "handle_world", "device", "device_world")
    assert set(parents) == {f"left/{name}" for name in names}
    assert parents["left/handle"] == "left/link2"
    assert parents["left/link4"] == parents["left/device_world"] == "world"
    assert (six(forces[-1]), six(felt[-1])) == (CONTACT.tolist(), FELT)
    assert forces[-1].header.frame_id == "left/handle_world"
    assert felt[-1].header.frame_id == "left/device_world"


def test_several_users_are_heard_in_their_namespaces(tmp_path):
    stage, points = Stage(str(five_bar_of_two(tmp_path)), frame_prefix="lab/"), ("left", "right")
    frames, *felt = stage.heard("view/frames", *(f"{p}/view/device/servo_cf" for p in points))
    for number, point in enumerate(points, 1):
        stage.pose(f"{point}/device/measured_cp", 0.1 * number)
        push(stage.graph, f"/{point}/device/servo_cf", [float(number), *[0.0] * 5])
        stage.count(f"{point}/analysis/{point}/constraint_count", number)
    seen = stage.seen()
    assert seen["count/left"].text == "left: 1 joint constraint"
    assert seen["count/right"].text == "right: 2 joint constraints"
    balls = [seen[f"device/{point}"] for point in points]
    assert [ball.pose.position.x for ball in balls] == [0.1, 0.2]
    assert balls[0].color != balls[1].color
    assert {f"device_command/{point}" for point in points} <= seen.keys()
    assert {f"lab/{p}/device" for p in points} <= {frame.child_frame_id for frame in frames}
    for number, (point, wrenches) in enumerate(zip(points, felt, strict=True), 1):
        assert six(wrenches[-1])[0] == number
        assert wrenches[-1].header.frame_id == f"lab/{point}/device_world"
    with pytest.raises(HapticMechError, match="held"):
        Stage(str(five_bar_of_two(tmp_path)), held_points="left, left")
