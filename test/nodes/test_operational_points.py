# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Held elsewhere while the graph runs: by topic and by parameter, told to all, without a bump."""

from __future__ import annotations

import numpy as np
import pytest
from geometry_msgs.msg import PoseStamped

from benchmarks.reliability.fake_graph import FakeGraph
from hapticmech_ros import load_scene
from hapticmech_ros.errors import InvalidInputError
from hapticmech_ros.mechanism.closures import flat_grasp, grasp_written
from hapticmech_ros.nodes.mechanism_simulator import MechanismSimulator
from hapticmech_ros.wire.bounds import read
from hapticmech_ros.wire.cdr import decode
from hapticmech_ros.wire.messages import OperationalModelMessage
from hapticmech_ros.wire.state import StateLayout
from nodes.stand_ins import heard, say
from ros.harness import six

SCENE = load_scene("five_bar")
# N from one command to the next; what the hand is promised not to feel.
BUMP_N = 0.1


def hold(graph, frame, x=0.0, y=0.0, w=1.0):
    """Ask for the point to be put elsewhere, and let the graph go on a little."""
    message = PoseStamped()
    message.pose.position.x, message.pose.position.y, message.pose.orientation.w = x, y, w
    say(graph, "/mechanism/handle/set_operational_point", message, frame)
    graph.run(0.05)


def position(message):
    return [message.pose.position.x, message.pose.position.y, message.pose.position.z]


@pytest.fixture
def graph():
    return FakeGraph("five_bar", actors=[MechanismSimulator])


def told(graph):
    """Return where the point is said to be: its link, and the place on it, m."""
    message = graph.last["/mechanism/handle/operational_point"]
    return message.header.frame_id, position(message)


def test_a_topic_and_a_parameter_put_the_point_elsewhere(graph):
    (poses,) = heard(graph, "/mechanism/handle/measured_cp")
    actor, start = graph.actor("mechanism_simulator"), SCENE.operational_point()
    graph.run(0.05)
    assert told(graph) == (start.link, list(start.origin.xyz))
    hold(graph, "link1", 0.02, 0.01)
    assert told(graph) == ("link1", [0.02, 0.01, 0.0])
    mechanism = actor.simulator.mechanism
    state = StateLayout(mechanism).unpack(decode(graph.last["/mechanism/state"]))
    point = grasp_written(SCENE, "", "link1 0.02 0.01 0")
    assert state.grasps[0].tolist() == flat_grasp(SCENE, point).tolist()
    expected = mechanism.frame_pose(state.q, "link1") * np.array([0.02, 0.01, 0.0])
    assert np.abs(np.array(position(poses[-1])) - expected).max() < 1e-12
    # Where it is in the world: on the link that is held, found from the present state.
    hold(graph, "world", 0.03, 0.04)
    assert told(graph)[0] == "link1"
    assert np.abs(np.array(position(poses[-1])) - [0.03, 0.04, 0.0]).max() < 1e-12
    for grasp, link in (("link3 0.01 0 0", "link3"), ("", start.link)):
        actor.apply_parameters(actor.parameters.model_copy(update={"grasp": grasp}))
        assert told(graph)[0] == link
    with pytest.raises(InvalidInputError, match="must be one of"):
        actor.validate_parameters(actor.parameters.model_copy(update={"grasp": "link9"}))


def test_places_that_are_not_there_are_refused(graph):
    before, host = told(graph), graph.hosts["mechanism_simulator"]
    bad = [("link9",), ("",), ("link3", np.nan), ("link3", 1e4), ("link3", 0.0, 0.0, 0.5)]
    for number, place in enumerate(bad, 1):
        hold(graph, *place)
        assert host.refused == number
    assert told(graph) == before


def test_the_hand_feels_no_bump():
    graph = FakeGraph("five_bar")
    commands, frames = heard(graph, "/device/servo_cf", "/view/frames")
    # The hand begins after 0.25 s, which is a bump of its own.
    graph.run(0.5)
    assert six(commands[-1])[0] > 0.1
    before = len(commands) - 1
    hold(graph, "link1", 0.02, 0.01)
    graph.run(0.6)
    controller = graph.actor("teleoperation_controller")
    assert controller.status()[2]["grasps"] == controller.status()[2]["engagements"] == "1"
    assert six(commands[-1])[0] > 0.1
    forces = np.array([six(one)[:3] for one in commands[before:]])
    assert len(forces) > 600
    assert np.linalg.norm(np.diff(forces, axis=0), axis=1).max() < BUMP_N
    on = [frame.header.frame_id for frame in frames if frame.child_frame_id == "handle"]
    assert on[-1] == "link1"
    topic = "/analysis/handle/operational_model"
    found = read(OperationalModelMessage, decode(graph.last[topic]))
    assert found.grasp[0] == 0.0
    # A link on a pin in the world: one direction is free, where the handle had two.
    assert np.count_nonzero(found.s > 1e-6) == 1
