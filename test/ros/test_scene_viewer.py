# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The viewer alone: it draws what it hears, drops what is over, and nothing kills it."""

from __future__ import annotations

from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest
from geometry_msgs.msg import PoseStamped, TransformStamped, WrenchStamped
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray, String, UInt8
from visualization_msgs.msg import Marker, MarkerArray

from hapticmech_ros import Mechanism, load_scene
from hapticmech_ros.mechanism.closures import flat_grasps
from hapticmech_ros.mechanism.projection import consistent_initial_state
from hapticmech_ros.nodes.messages import LATCHED, set_stamp
from hapticmech_ros.view import Placer
from hapticmech_ros.wire.state import StateLayout, WireState
from oracles.users import five_bar_of_two
from ros.harness import RELIABLE, Peer, Statuses, refuses, running, six

CONTACT = np.array([[0.4, -0.2, 0.0, 0.0, 0.0, 0.005]])
FELT = [1.0, 2.0, 3.0, 4.0, 5.0, 6.0]
MECHANISM = Mechanism(load_scene("five_bar"))
Q, _ = consistent_initial_state(MECHANISM)
V = np.array((0.1, -0.2, 0.3, -0.4))


def state(peer: Peer, closed: bool = True, now_ns: int | None = None) -> Float64MultiArray:
    now = peer.node.get_clock().now().nanoseconds if now_ns is None else now_ns
    told = WireState(now, (closed,), Q, V, CONTACT, flat_grasps(MECHANISM.scene), (True,))
    return Float64MultiArray(data=StateLayout(MECHANISM).pack(told).tolist())


def namespaces(message: MarkerArray) -> set[str]:
    return {marker.ns for marker in message.markers if marker.action == Marker.ADD}


def children(frames: list[TransformStamped]) -> set[str]:
    return {frame.child_frame_id for frame in frames}


class Stage:
    """A peer that says the same things until something is seen."""

    def __init__(self, peer: Peer) -> None:
        self.peer = peer
        self.pictures = peer.listen("view/markers", MarkerArray)
        self.publishers: dict[str, Any] = {}
        self.messages: dict[str, Any] = {}

    def says(self, topic: str, kind: Any, message: Any) -> None:
        """Say what ``message()`` returns from now on, once somebody listens."""
        if topic not in self.publishers:
            self.publishers[topic] = self.peer.node.create_publisher(kind, topic, RELIABLE)
            readers = self.publishers[topic].get_subscription_count
            self.until(lambda: readers() > 0, f"a subscriber of {topic}")
        self.messages[topic] = message

    def hushes(self, topic: str) -> None:
        """Say nothing more on a topic."""
        del self.messages[topic]

    def say(self) -> None:
        for topic, message in self.messages.items():
            self.publishers[topic].publish(message())

    def until(self, condition: Any, what: str) -> None:
        self.peer.until(condition, what, doing=self.say)


def test_the_picture_has_what_is_heard_and_loses_what_is_over(domain: int, peer: Peer) -> None:
    stage = Stage(peer)
    with running("scene_viewer", domain, input_timeout=0.3) as process:
        stage.says("mechanism/state", Float64MultiArray, lambda: state(peer))
        stage.until(lambda: stage.pictures, "a picture")
        assert stage.pictures[0].markers[0].action == Marker.DELETEALL
        mechanism = {"links", "joints", "closures", "point/handle", "point/handle_world"}
        assert mechanism <= namespaces(stage.pictures[-1])
        assert "contact_force" in namespaces(stage.pictures[-1])
        assert not {"device", "hand_force"} & namespaces(stage.pictures[-1])
        (arrow,) = [m for m in stage.pictures[-1].markers if m.ns == "contact_force"]
        tail, tip = arrow.points
        place = Placer(MECHANISM).at(Q).points["handle"].translation
        assert [tail.x, tail.y] == pytest.approx(place[:2], abs=1e-12)
        assert [tip.x - tail.x, tip.y - tail.y] == pytest.approx(0.05 * CONTACT[0, :2], abs=1e-12)

        stage.says("device/measured_cp", PoseStamped, lambda: peer.pose(0.2, 0.1))
        stage.says("device/hand/measured_cf", WrenchStamped, lambda: peer.wrench(1.0, *[0.0] * 5))
        stage.says("device/servo_cf", WrenchStamped, lambda: peer.wrench(-1.0, *[0.0] * 5))
        stage.says("mechanism/handle/servo_cf", WrenchStamped, lambda: peer.wrench(*[0.5] * 6))
        stage.says("analysis/handle/constraint_count", UInt8, lambda: UInt8(data=2))
        wanted = {"device", "hand_force", "device_command", "point_command", "rigid_directions"}
        stage.until(lambda: wanted <= namespaces(stage.pictures[-1]), "everything that is said")
        stage.until(lambda: letters(stage.pictures[-1]) == "2 joint constraints", "the count")

        stage.hushes("device/hand/measured_cf")
        stage.until(
            lambda: ("hand_force", 0) in deleted(stage.pictures),
            "the deletion of a force that is over",
        )
        assert "hand_force" not in namespaces(stage.pictures[-1])
        stage.says("mechanism/state", Float64MultiArray, lambda: state(peer, closed=False))
        stage.until(lambda: "open_closures" in namespaces(stage.pictures[-1]), "the open loop")
        assert ("closures", 0) in deleted(stage.pictures)
        assert process.poll() is None


def test_it_listens_while_it_is_active_and_somebody_looks_as_he_wants(
    domain: int, peer: Peer, statuses: Statuses
) -> None:
    states = peer.node.create_publisher(Float64MultiArray, "mechanism/state", 10)
    with running("scene_viewer", domain, diagnostics_period=0.02):
        peer.until(lambda: "scene_viewer" in statuses, "diagnostics")
        peer.until(lambda: statuses["scene_viewer"].message == "no subscribers", "rest")
        assert states.get_subscription_count() == 0
        looking = peer.node.create_subscription(MarkerArray, "view/markers", lambda _: None, 10)
        peer.until(lambda: states.get_subscription_count() == 1, "a subscription")
        peer.node.destroy_subscription(looking)
        peer.until(lambda: states.get_subscription_count() == 0, "rest again")
        stage = Stage(peer)
        stage.says("mechanism/state", Float64MultiArray, lambda: state(peer))
        stage.until(lambda: any("links" in namespaces(one) for one in stage.pictures), "a picture")

        assert peer.set_parameters("scene_viewer", force_scale=0.2).successful
        assert peer.set_parameters("scene_viewer", marker_rate=60.0).successful
        assert not peer.set_parameters("scene_viewer", marker_rate=0.0).successful
        wanted = 0.2 * np.linalg.norm(CONTACT[0, :3])
        stage.until(lambda: abs(length(stage.pictures[-1]) - wanted) < 1e-9, "a longer arrow")

        assert peer.transition("scene_viewer", "deactivate")
        peer.until(lambda: not namespaces(stage.pictures[-1]), "an empty picture")
        assert [marker.action for marker in stage.pictures[-1].markers] == [Marker.DELETEALL]
        peer.until(lambda: states.get_subscription_count() == 0, "rest once more")
        assert peer.transition("scene_viewer", "activate")
        stage.until(lambda: "links" in namespaces(stage.pictures[-1]), "a picture again")


def test_in_simulated_time_pictures_come_with_the_clock(domain: int, peer: Peer) -> None:
    times = iter(range(10**9, 10**12, 10**7))
    sent = [0]

    def tell_time() -> Clock:
        sent[0] = next(times)
        clock = Clock()
        set_stamp(clock.clock, sent[0])
        return clock

    stage = Stage(peer)
    with running("scene_viewer", domain, use_sim_time=True):
        stage.says("/clock", Clock, tell_time)
        stage.says("mechanism/state", Float64MultiArray, lambda: state(peer, now_ns=sent[0]))
        stage.until(lambda: any(namespaces(m) for m in stage.pictures), "a picture")
    assert stage.pictures[-1].markers[-1].header.stamp.sec < 1000


def test_bad_messages_are_refused_and_the_rest_is_drawn(domain: int, peer: Peer) -> None:
    stage, statuses = Stage(peer), peer.statuses()
    with running("scene_viewer", domain, diagnostics_period=0.02) as process:
        states = peer.publisher("mechanism/state", Float64MultiArray)
        for bad in (Float64MultiArray(), Float64MultiArray(data=[0.5] * 18)):
            refuses(peer, statuses, "scene_viewer", states, bad)
        stage.says("mechanism/state", Float64MultiArray, lambda: state(peer))
        stage.says("analysis/handle/constraint_count", UInt8, lambda: UInt8(data=200))
        stage.until(
            lambda: "constraint_count" in statuses.figure("scene_viewer", "last_refusal"),
            "refusal of the count",
        )
        stage.says("analysis/handle/constraint_count", UInt8, lambda: UInt8(data=1))
        poses = peer.publisher("device/measured_cp", PoseStamped)
        bad_pose = peer.pose(0.1, w=0.5)
        stage.until(
            lambda: poses.publish(bad_pose) or stage.pictures, "a picture without the device"
        )
        assert "device" not in namespaces(stage.pictures[-1])
        assert process.poll() is None


def test_model_joints_frames_and_wrenches(domain: int, peer: Peer) -> None:
    """Two graphs do not place each other's links: frames have a namespace before them."""
    descriptions = peer.listen("left/robot_description", String, LATCHED)
    joints = peer.listen("left/joint_states", JointState)
    frames = peer.listen("left/view/frames", TransformStamped)
    forces = peer.listen("left/view/handle/measured_cf", WrenchStamped)
    felt = peer.listen("left/view/device/servo_cf", WrenchStamped)
    stage = Stage(peer)
    with running("scene_viewer", domain, arguments=["-r", "__ns:=/left"]):
        stage.says("left/mechanism/state", Float64MultiArray, lambda: state(peer))
        stage.says("left/device/measured_cp", PoseStamped, lambda: peer.pose(0.2, 0.1))
        stage.says("left/device/servo_cf", WrenchStamped, lambda: peer.wrench(*FELT))
        names = {"link1", "link2", "link3", "link4", "handle", "handle_world", "device"}
        wanted = {f"left/{name}" for name in (*names, "device_world")}
        stage.until(lambda: descriptions and joints and forces and felt, "model and the rest")
        stage.until(lambda: wanted <= children(frames), "frames")
    robot = ElementTree.fromstring(descriptions[-1].data.encode())
    moving = {j.get("name") for j in robot.findall("joint") if j.get("type") != "fixed"}
    assert set(joints[-1].name) == moving
    assert list(joints[-1].position) == pytest.approx(Q, abs=1e-12)
    assert list(joints[-1].velocity) == pytest.approx(V, abs=1e-12)
    parents = {frame.child_frame_id: frame.header.frame_id for frame in frames}
    assert set(parents) == wanted
    assert parents["left/handle"] == "left/link2"
    assert parents["left/link4"] == parents["left/device_world"] == "world"
    assert six(forces[-1]) == CONTACT[0].tolist()
    assert forces[-1].header.frame_id == "left/handle_world"
    assert six(felt[-1]) == FELT
    assert felt[-1].header.frame_id == "left/device_world"


def test_several_users_are_heard_in_their_namespaces(
    domain: int, peer: Peer, tmp_path: Path
) -> None:
    scene = str(five_bar_of_two(tmp_path))
    mechanism = Mechanism(load_scene(scene))
    layout, points = StateLayout(mechanism), ("left", "right")

    def told() -> Float64MultiArray:
        now = peer.node.get_clock().now().nanoseconds
        grasps, contacts = flat_grasps(mechanism.scene), np.zeros((2, 6))
        found = WireState(now, (True,), Q, V, contacts, grasps, (True, True))
        return Float64MultiArray(data=layout.pack(found).tolist())

    frames = peer.listen("view/frames", TransformStamped)
    felt = {p: peer.listen(f"{p}/view/device/servo_cf", WrenchStamped) for p in points}
    stage = Stage(peer)
    with running("scene_viewer", domain, scene, frame_prefix="lab/"):
        stage.says("mechanism/state", Float64MultiArray, told)
        for i, point in enumerate(points):
            place, force = 0.1 * (i + 1), [float(i + 1), *[0.0] * 5]
            stage.says(
                f"{point}/device/measured_cp", PoseStamped, lambda x=place: peer.pose(x, 0.1)
            )
            stage.says(f"{point}/device/servo_cf", WrenchStamped, lambda f=force: peer.wrench(*f))
            stage.says(
                f"{point}/analysis/{point}/constraint_count",
                UInt8,
                lambda n=i + 1: UInt8(data=n),
            )
        wanted = {f"{one}/{p}" for one in ("device", "device_command", "count") for p in points}
        stage.until(
            lambda: stage.pictures and wanted <= namespaces(stage.pictures[-1]), "both users"
        )
        stage.until(lambda: all(felt.values()), "the wrenches of both")
        devices = {f"lab/{p}/device" for p in points}
        stage.until(lambda: devices <= children(frames), "frames of both devices")

        def texts() -> dict[str, str]:
            return {m.ns: m.text for m in stage.pictures[-1].markers if m.ns.startswith("count/")}

        counted = {
            "count/left": "left: 1 joint constraint",
            "count/right": "right: 2 joint constraints",
        }
        # Until a count is heard, the state tells how many there are.
        stage.until(lambda: texts() == counted, "both counts")
    balls = {m.ns: m for m in stage.pictures[-1].markers if m.ns.startswith("device/") and not m.id}
    assert [balls[f"device/{p}"].pose.position.x for p in points] == [0.1, 0.2]
    assert balls["device/left"].color != balls["device/right"].color
    for i, point in enumerate(points):
        assert six(felt[point][-1])[0] == i + 1
        assert felt[point][-1].header.frame_id == f"lab/{point}/device_world"


def test_points_that_are_held_twice_are_refused(domain: int, peer: Peer, tmp_path: Path) -> None:
    scene = str(five_bar_of_two(tmp_path))
    with running("scene_viewer", domain, scene, autostart=False, held_points="left, left"):
        assert not peer.transition("scene_viewer", "configure")
        assert peer.set_parameters("scene_viewer", held_points="left").successful
        assert peer.transition("scene_viewer", "configure")


def length(picture: MarkerArray) -> float:
    for marker in picture.markers:
        if marker.ns == "contact_force" and marker.action == Marker.ADD:
            tail, tip = marker.points
            return float(np.hypot(tip.x - tail.x, tip.y - tail.y))
    return 0.0


def letters(picture: MarkerArray) -> str:
    return "".join(m.text for m in picture.markers if m.ns == "count")


def deleted(pictures: list[MarkerArray]) -> set[tuple[str, int]]:
    markers = [marker for picture in pictures for marker in picture.markers]
    return {(m.ns, m.id) for m in markers if m.action == Marker.DELETE}
