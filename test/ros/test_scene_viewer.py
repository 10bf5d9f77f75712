# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The viewer's node: it listens while somebody looks, by the clock that it is given.

What it draws: test/nodes/test_scene_viewer.py.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from rosgraph_msgs.msg import Clock
from std_msgs.msg import Float64MultiArray
from visualization_msgs.msg import Marker, MarkerArray

from hapticmech_ros import Mechanism, load_scene
from hapticmech_ros.mechanism.closures import flat_grasps
from hapticmech_ros.mechanism.projection import consistent_initial_state
from hapticmech_ros.nodes.messages import set_stamp
from hapticmech_ros.wire.state import StateLayout, WireState
from ros.harness import RELIABLE, Peer, Statuses, running

CONTACT = np.array([[0.4, -0.2, 0.0, 0.0, 0.0, 0.005]])
MECHANISM = Mechanism(load_scene("five_bar"))
Q, _ = consistent_initial_state(MECHANISM)
V = np.array((0.1, -0.2, 0.3, -0.4))


def state(peer: Peer, now_ns: int | None = None) -> Float64MultiArray:
    now = peer.node.get_clock().now().nanoseconds if now_ns is None else now_ns
    told = WireState(now, (True,), Q, V, CONTACT, flat_grasps(MECHANISM.scene), (True,))
    return Float64MultiArray(data=StateLayout(MECHANISM).pack(told).tolist())


def namespaces(message: MarkerArray) -> set[str]:
    return {marker.ns for marker in message.markers if marker.action == Marker.ADD}


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

    def say(self) -> None:
        for topic, message in self.messages.items():
            self.publishers[topic].publish(message())

    def until(self, condition: Any, what: str) -> None:
        self.peer.until(condition, what, doing=self.say)


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


def length(picture: MarkerArray) -> float:
    for marker in picture.markers:
        if marker.ns == "contact_force" and marker.action == Marker.ADD:
            tail, tip = marker.points
            return float(np.hypot(tip.x - tail.x, tip.y - tail.y))
    return 0.0
