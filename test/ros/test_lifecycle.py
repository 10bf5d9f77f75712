# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Managed nodes: up and down by services, silent unless active, and ended from any state."""

from __future__ import annotations

import signal

import numpy as np
import pytest
from geometry_msgs.msg import WrenchStamped
from rclpy.node import NodeNameNonExistentError
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray

from hapticmech_ros import Simulator, load_scene
from hapticmech_ros.bag.check import OPTIONAL
from hapticmech_ros.nodes.entry import NODES
from hapticmech_ros.wire.topics import TOPICS
from ros.harness import Peer, Statuses, running

ALL = ",".join(NODES)
# Where ROS 2 itself publishes, for every managed node.
INFRASTRUCTURE = ("/diagnostics", "/rosout", "/parameter_events", "/transition_event")
# Long enough for anything on its way to arrive, and for hundreds of periods.
QUIET_S = 0.3


def test_nodes_left_to_others_go_up_and_down_by_services(domain: int, peer: Peer) -> None:
    streams = {
        "haptic_device": peer.listen("device/state", Float64MultiArray),
        "mechanism_simulator": peer.listen("mechanism/state", Float64MultiArray),
        "nullspace_analyser": peer.listen("analysis/handle/operational_model", Float64MultiArray),
        "teleoperation_controller": peer.listen("mechanism/handle/servo_cf", WrenchStamped),
    }

    def seen() -> dict[str, int]:
        return {node: len(stream) for node, stream in streams.items()}

    with running(ALL, domain, autostart=False):
        for node in NODES:
            assert peer.state_of(node) == "unconfigured"
            _until_topics(peer, node, set())
            assert not peer.transition(node, "activate")
        for step, state in (("configure", "inactive"), ("activate", "active")):
            for node in NODES:
                assert peer.transition(node, step)
                assert peer.state_of(node) == state
                _until_topics(peer, node, _table(node))
            if state == "inactive":
                peer.run(QUIET_S)
                assert not any(streams.values())
        peer.until(lambda: min(seen().values()) > 100, "all nodes at work")
        # Those who answer first: they hear what goes on, and keep silent.
        for node in reversed(NODES):
            assert peer.transition(node, "deactivate")
            assert peer.state_of(node) == "inactive"
            peer.run(QUIET_S)
            before = len(streams[node])
            peer.run(QUIET_S)
            assert len(streams[node]) == before, node
        for node in NODES:
            assert peer.transition(node, "cleanup")
            assert peer.state_of(node) == "unconfigured"
            _until_topics(peer, node, set())
        # And all of it again.
        for node in NODES:
            assert peer.transition(node, "configure", "activate")
        before = seen()
        peer.until(lambda: all(seen()[node] > before[node] + 100 for node in NODES), "work again")


@pytest.mark.parametrize(
    ("steps", "number"),
    [(None, signal.SIGINT), ((), signal.SIGINT), (("configure",), signal.SIGTERM)],
    ids=["active", "new", "inactive"],
)
def test_two_signals_end_a_node_in_any_state(
    domain: int, peer: Peer, steps: tuple[str, ...] | None, number: signal.Signals
) -> None:
    given = {} if steps is None else {"autostart": False}
    expected = "active" if steps is None else "inactive" if steps else "unconfigured"
    with running(ALL, domain, **given) as process:
        for node in NODES:
            assert peer.transition(node, *(steps or ()))
            peer.until(lambda node=node: peer.state_of(node) == expected, f"{node} {expected}")
        process.send_signal(number)
        process.send_signal(number)
        assert process.wait(20.0) == 0


def test_a_bad_scene_is_refused_and_a_good_one_taken(
    domain: int, peer: Peer, statuses: Statuses, capfd: pytest.CaptureFixture[str]
) -> None:
    joints = peer.listen("mechanism/measured_js", JointState)
    given = {"scene": "no_such_scene", "autostart": False, "diagnostics_period": 0.05}
    with running("mechanism_simulator", domain, **given) as process:
        assert not peer.transition("mechanism_simulator", "configure")
        assert peer.state_of("mechanism_simulator") == "unconfigured"
        _until_topics(peer, "mechanism_simulator", set())
        peer.until(
            lambda: "no_such_scene" in statuses.sentence("mechanism_simulator"), "the reason"
        )
        assert process.poll() is None
        for bad in ({"operational_point": "nowhere"}, {"held_points": "handle,nowhere"}):
            assert peer.set_parameters("mechanism_simulator", scene="two_link", **bad).successful
            assert not peer.transition("mechanism_simulator", "configure")
            assert peer.set_parameters(
                "mechanism_simulator", operational_point="", held_points=""
            ).successful
        assert peer.transition("mechanism_simulator", "configure", "activate")
        peer.until(lambda: joints, "the mechanism")
        peer.until(lambda: "closed loops" in statuses.sentence("mechanism_simulator"), "health")
        assert statuses["mechanism_simulator"].hardware_id == "two_link"
    assert list(joints[0].name) == ["joint1", "joint2"]
    error = capfd.readouterr().err
    assert "no_such_scene" in error
    assert "nowhere" in error


def test_a_mechanism_goes_on_after_a_pause_and_anew_after_a_cleanup(
    domain: int, peer: Peer
) -> None:
    joints = peer.listen("mechanism/measured_js", JointState)
    start = Simulator(load_scene("five_bar")).initial_state().q.tolist()
    name = "mechanism_simulator"
    with running(name, domain):
        push = peer.publisher("mechanism/handle/external_cf", WrenchStamped)

        peer.until(
            lambda: bool(joints) and np.abs(np.subtract(joints[-1].position, start)).max() > 0.02,
            "the mechanism to move",
            doing=lambda: push.publish(peer.wrench(-0.4, 0.1, 0.0, 0.0, 0.0, 0.0)),
        )
        assert peer.transition(name, "deactivate")
        peer.run(QUIET_S)
        seen = len(joints)
        assert peer.transition(name, "activate")
        peer.until(lambda: len(joints) > seen + 5, "states after the pause")
        paused = [joint.position for joint in joints[seen:]]
        assert np.abs(np.subtract(paused[0], start)).max() > 0.02
        assert np.ptp(paused, axis=0).max() == 0.0
        assert peer.transition(name, "deactivate", "cleanup", "configure", "activate")
        peer.until_more(joints, 5, "states after the cleanup")
    assert list(joints[-1].position) == start
    assert not any(joints[-1].velocity)


def _table(node: str) -> set[str]:
    """Return the full names of what a node publishes in a scene without contacts, by the table."""
    own = [topic for topic in TOPICS if topic.publisher == node]
    # Poses that a device is commanded to are published while it is, by a publisher that is there.
    names = {topic.of("handle") for topic in own if topic.rate not in OPTIONAL - {"servo"}}
    return {f"/{name}" for name in names}


def _topics(peer: Peer, node: str) -> set[str]:
    """Return what a node publishes, apart from what ROS 2 does."""
    try:
        found = peer.node.get_publisher_names_and_types_by_node(node, "/")
    except NodeNameNonExistentError:
        return {"not discovered"}
    return {name for name, _ in found if not name.endswith(INFRASTRUCTURE)}


def _until_topics(peer: Peer, node: str, expected: set[str]) -> None:
    peer.until(lambda: _topics(peer, node) == expected, f"{node} publishing on {expected}")
