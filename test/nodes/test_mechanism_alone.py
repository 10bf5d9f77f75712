# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The mechanism without the other nodes: what it tells, loops that open and close, and pushes."""

from __future__ import annotations

import numpy as np
import pytest
from std_srvs.srv import SetBool

from benchmarks.reliability.fake_graph import FakeGraph
from hapticmech_ros import Simulator, load_scene
from hapticmech_ros.errors import InvalidInputError
from hapticmech_ros.nodes.mechanism_simulator import MechanismSimulator
from nodes.stand_ins import heard, push
from oracles.kinematics import link_poses
from ros.harness import six

NODE = "mechanism_simulator"
ON_HANDLE, ON_FOREARM = (
    f"/mechanism/{name}/external_cf/persistent" for name in ("handle", "forearm")
)


def alone(scene, *pushing):
    return FakeGraph(scene, pushing, [MechanismSimulator])


def test_it_tells_joints_pose_and_closures():
    graph = alone("five_bar")
    joints, poses = heard(graph, "/mechanism/measured_js", "/mechanism/handle/measured_cp")
    graph.run(0.1)
    assert list(joints[-1].name) == ["joint1", "joint2", "joint3", "joint4"]
    assert list(joints[-1].position) == Simulator(load_scene("five_bar")).initial_state().q.tolist()
    assert poses[-1].header.frame_id == "world"
    closures = graph.last["/mechanism/closures"]
    assert (list(closures.data), closures.layout.dim[0].label) == ([1], "ground_pin")


def test_a_timeout_that_cannot_hold_is_refused_while_it_runs():
    actor = alone("five_bar").actor(NODE)
    with pytest.raises(InvalidInputError, match="command_timeout: must be 0 or at least 3 periods"):
        actor.validate_parameters(actor.parameters.model_copy(update={"command_timeout": 0.002}))


def test_closures_open_and_close_by_service():
    topic = "/mechanism/handle/external_cf"
    graph = alone("five_bar", topic)
    graph.run(0.3)

    def switched(on):
        service = graph.hosts[NODE].services["mechanism/closures/ground_pin"]
        answer = service(SetBool.Request(data=on), SetBool.Response())
        graph.run(0.01)
        return answer

    for on in (False, True, False):
        assert switched(on).success
        assert list(graph.last["/mechanism/closures"].data) == [on]
    while graph.actor(NODE).state.account.work_in < 0.02:
        push(graph, topic, (-2.0, 1.0, 0.0, 0.0, 0.0, 0.0))
        graph.run(1e-3)
    refused = switched(True)
    assert not refused.success
    assert "distance of closure ground_pin" in refused.message
    assert list(graph.last["/mechanism/closures"].data) == [0]


@pytest.fixture
def arm():
    found = alone("spatial_arm", ON_HANDLE, ON_FOREARM)
    found.run(0.3)
    return found


def test_a_pushed_link_moves_the_mechanism_as_the_core_says(arm):
    (forces,) = heard(arm, "/mechanism/handle/measured_cf")
    wrench = np.array([0.1, 0.2, -0.3, 0.01, 0.0, 0.02])
    mechanism, simulator = arm.actor(NODE), Simulator(load_scene("spatial_arm"))
    push(arm, ON_FOREARM, wrench)
    start = expected = mechanism.state
    arm.run(0.2)
    for _ in range(round((mechanism.state.time - start.time) * 1000)):
        expected = simulator.step(expected, np.zeros((1, 6)), {"forearm": wrench})
    assert np.abs(expected.v).max() > 0.2
    # The first step may be under what was known before.
    assert mechanism.state.v == pytest.approx(expected.v, rel=0.01, abs=1e-3)
    # What the contact at the handle is, is not changed by pushes on links.
    assert all(six(force) == [0.0] * 6 for force in forces)


def test_axes_of_a_push_are_those_of_its_frame(arm):
    (forces,) = heard(arm, "/mechanism/handle/measured_cf")
    # So small that the arm stays where it is: the frames are those of the start.
    force, torque = 1e-4 * np.array([1.0, 2.0, 3.0]), 1e-5 * np.array([3.0, -1.0, 2.0])
    links = [
        {
            "name": link.name,
            "parent": link.parent,
            "joint": {
                "type": "revolute",
                "axis": link.joint.axis,
                "origin": {"xyz": link.joint.origin.xyz, "rpy": link.joint.origin.rpy},
            },
        }
        for link in load_scene("spatial_arm").links
    ]
    poses = link_poses({"links": links}, arm.actor(NODE).state.q)
    hand, upper_arm = poses["hand"][0], poses["upper_arm"][0]
    assert np.abs(hand - upper_arm).max() > 0.3
    axes = {"hand": hand, "handle": hand, "upper_arm": upper_arm}
    for frame, turn in {**axes, "handle_world": np.eye(3), "world": np.eye(3)}.items():
        push(arm, ON_HANDLE, [*force, *torque], frame)
        arm.run(0.02)
        # Only the axes turn: the force acts at the handle, and brings no torque of its own.
        expected = [*(turn @ force), *(turn @ torque)]
        assert six(forces[-1]) == pytest.approx(expected, abs=1e-6)
