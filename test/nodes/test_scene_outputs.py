# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What the viewer publishes, with stand-ins for node and tf2_msgs: to whom, when, and how."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from rclpy.qos import DurabilityPolicy
from visualization_msgs.msg import Marker

from hapticmech_ros import Mechanism, load_scene
from hapticmech_ros.mechanism.closures import flat_grasps
from hapticmech_ros.nodes.exchange import Exchange, Outlet
from hapticmech_ros.nodes.viewer.scene_inputs import Received, ReceivedUser
from hapticmech_ros.nodes.viewer.scene_viewer import SceneOutputs
from hapticmech_ros.view import Placer, moving_frames
from hapticmech_ros.view.shapes import numbered, sphere
from hapticmech_ros.wire.state import WireState
from nodes.stand_ins import Publisher

NOW = 10**18
DEVICE = pin.SE3(np.eye(3), np.ones(3))


@dataclass
class TfMessage:
    """Stands for tf2_msgs' TFMessage, which is not on PyPI."""

    transforms: list[Any] = field(default_factory=list)


class StandInActor:
    """Has what SceneOutputs asks of an actor."""

    def __init__(self) -> None:
        self.made: dict[str, Any] = {}

    def output_named(self, name: str, kind: Any, qos: Any) -> Outlet:
        self.made[name] = Publisher(0)
        self.made[name].qos = qos
        stays = qos is not None and qos.durability == DurabilityPolicy.TRANSIENT_LOCAL
        return Exchange().outlet(self.made[name], name, stays)

    def output(self, topic: Any, kind: Any, qos: Any = None, point: str = "handle") -> Outlet:
        return self.output_named(topic.of(point), kind, qos)

    output_qos = None

    def now_ns(self) -> int:
        return NOW


class Stage:
    """Outputs of the five-bar's viewer, and everything that can be shown."""

    def __init__(self, tf_type: Any = TfMessage, prefix: str = "") -> None:
        self.actor = StandInActor()
        mechanism = Mechanism(load_scene("five_bar"))
        self.outputs = SceneOutputs(self.actor, mechanism, {"handle": ""}, prefix, tf_type)  # type: ignore[arg-type]
        self.q = np.zeros(mechanism.nq)
        self.moving = moving_frames(mechanism.scene, Placer(mechanism).at(self.q), {"": DEVICE})
        told = WireState(
            NOW, (True,), self.q, self.q, np.ones((1, 6)), flat_grasps(mechanism.scene), (True,)
        )
        force = np.arange(6.0)
        user = ReceivedUser(DEVICE, force, force, 1)
        self.received = Received(told, {"handle": user}, {"handle": force})

    def sent(self, name: str) -> list[Any]:
        return self.actor.made[name].sent

    def show_all(self) -> None:
        self.outputs.show_frames(self.moving, NOW)
        self.outputs.show_joints(self.q, self.q, NOW)
        self.outputs.show_wrenches(self.received, NOW)


def balls(count: int) -> list[Any]:
    return numbered("a", [sphere(np.zeros(3), 0.1, (1.0, 1.0, 1.0, 1.0))] * count)


def test_what_nobody_looks_at_is_not_published() -> None:
    stage = Stage()
    stage.show_all()
    latched = {"robot_description", "/tf_static"}
    assert {name for name, p in stage.actor.made.items() if p.sent} == latched
    for publisher in stage.actor.made.values():
        publisher.subscriptions = 1
    stage.show_all()
    assert {n for n, p in stage.actor.made.items() if not p.sent} == {"view/markers"}


def test_tf_has_what_moves_and_tf_static_has_what_stays() -> None:
    stage = Stage(prefix="left/")
    stage.actor.made["/tf"].subscriptions = 1
    stage.outputs.show_frames(stage.moving, NOW)
    (moving,), (fixed,) = stage.sent("/tf"), stage.sent("/tf_static")
    assert {t.header.frame_id for t in moving.transforms} == {"world"}
    assert "left/link4" in {t.child_frame_id for t in moving.transforms}
    (point,) = fixed.transforms
    assert (point.header.frame_id, point.child_frame_id) == ("left/link2", "left/handle")
    static = stage.actor.made["/tf_static"].qos
    assert static.durability == DurabilityPolicy.TRANSIENT_LOCAL


def test_without_tf2_msgs_the_frames_are_published_all_the_same() -> None:
    stage = Stage(tf_type=None)
    assert not {"/tf", "/tf_static"} & set(stage.actor.made)
    frames = stage.actor.made["view/frames"]
    frames.subscriptions = 1
    stage.outputs.show_frames(stage.moving, NOW)
    names = [message.child_frame_id for message in frames.sent]
    assert names == [frame.child for frame in stage.moving] + ["handle"]
    # All of them go out at once, and none may push another out of the queue.
    assert frames.qos.depth >= len(names)


def test_a_reader_who_comes_back_gets_a_clean_picture() -> None:
    stage = Stage()
    markers = stage.actor.made["view/markers"]
    markers.subscriptions = 1
    for count in (3, 2):
        assert stage.outputs.wants_markers()
        stage.outputs.show_markers(balls(count), NOW, 1.0)
    first, second = ([m.action for m in message.markers] for message in markers.sent)
    assert first == [Marker.DELETEALL, *[Marker.ADD] * 3]
    assert second == [Marker.DELETE, *[Marker.ADD] * 2]
    markers.subscriptions = 0
    assert not stage.outputs.wants_markers()
    markers.subscriptions = 1
    stage.outputs.show_markers(balls(2), NOW, 1.0)
    assert markers.sent[-1].markers[0].action == Marker.DELETEALL


@pytest.mark.parametrize("missing", ["device_command", "hand_wrench"])
def test_a_wrench_that_is_not_known_is_not_published(missing: str) -> None:
    stage = Stage()
    for publisher in stage.actor.made.values():
        publisher.subscriptions = 1
    user = replace(stage.received.users["handle"], **{missing: None})
    stage.outputs.show_wrenches(replace(stage.received, users={"handle": user}), NOW)
    empty = {
        "device_command": "view/device/servo_cf",
        "hand_wrench": "view/device/hand/measured_cf",
    }
    silent = {n for n, p in stage.actor.made.items() if n.endswith("_cf") and not p.sent}
    assert silent == {empty[missing]}
