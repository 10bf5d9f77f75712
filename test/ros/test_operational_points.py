# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Held elsewhere while the graph runs: by topic and by parameter, told to all, without a bump."""

from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from geometry_msgs.msg import PoseStamped, TransformStamped, WrenchStamped
from std_msgs.msg import Float64MultiArray

from hapticmech_ros import load_scene
from hapticmech_ros.mechanism import Mechanism
from hapticmech_ros.mechanism.closures import flat_grasp, grasp_written
from hapticmech_ros.nodes.entry import NODES
from hapticmech_ros.nodes.messages import LATCHED, stamp_ns
from hapticmech_ros.wire.bounds import read
from hapticmech_ros.wire.messages import OperationalModelMessage
from hapticmech_ros.wire.state import StateLayout
from ros.harness import Peer, Statuses, allowing, figures, refused, refuses, running, six

SCENE = load_scene("five_bar")
# N from one command to the next; what the hand is promised not to feel.
BUMP_N = 0.1


def grasp(peer: Peer, frame: str, *place: float) -> PoseStamped:
    return peer.pose(*place, frame=frame)


def position(message: PoseStamped) -> list[float]:
    return [message.pose.position.x, message.pose.position.y, message.pose.position.z]


def test_a_topic_and_a_parameter_put_the_point_elsewhere(domain: int, peer: Peer) -> None:
    poses = peer.listen("mechanism/handle/measured_cp", PoseStamped)
    told = peer.listen("mechanism/handle/operational_point", PoseStamped, LATCHED)
    states = peer.listen("mechanism/state", Float64MultiArray)
    mechanism = Mechanism(SCENE)
    layout = StateLayout(mechanism)
    with running("mechanism_simulator", domain):
        command = peer.publisher("mechanism/handle/set_operational_point", PoseStamped)
        peer.until(lambda: told and poses, "where the point is at the start")
        start = SCENE.operational_point()
        assert told[-1].header.frame_id == start.link
        assert position(told[-1]) == list(start.origin.xyz)
        command.publish(grasp(peer, "link1", 0.02, 0.01))
        peer.until(lambda: told[-1].header.frame_id == "link1", "the new place")
        assert position(told[-1]) == [0.02, 0.01, 0.0]
        peer.until_more(states, 5, "states")
        peer.until_more(poses, 5, "poses")
        state = layout.unpack(states[-1].data)
        point = grasp_written(SCENE, "", "link1 0.02 0.01 0")
        assert state.grasps[0].tolist() == flat_grasp(SCENE, point).tolist()
        expected = mechanism.frame_pose(state.q, "link1") * np.array([0.02, 0.01, 0.0])
        assert np.abs(np.array(position(poses[-1])) - expected).max() < 1e-12
        # Where it is in the world: on the link that is held, found from the present state.
        command.publish(grasp(peer, "world", 0.03, 0.04))
        peer.until(lambda: position(told[-1]) != [0.02, 0.01, 0.0], "the place in the world")
        peer.until_more(poses, 5, "poses")
        assert told[-1].header.frame_id == "link1"
        assert np.abs(np.array(position(poses[-1])) - [0.03, 0.04, 0.0]).max() < 1e-12
        assert peer.set_parameters("mechanism_simulator", grasp="link3 0.01 0 0").successful
        peer.until(lambda: told[-1].header.frame_id == "link3", "the parameter's place")
        refused(peer, "mechanism_simulator", ("must be one of",), grasp="link9")
        assert peer.set_parameters("mechanism_simulator", grasp="").successful
        peer.until(lambda: told[-1].header.frame_id == start.link, "the scene's place")


def test_places_that_are_not_there_are_refused(domain: int, peer: Peer, statuses: Statuses) -> None:
    told = peer.listen("mechanism/handle/operational_point", PoseStamped, LATCHED)
    with running("mechanism_simulator", domain, diagnostics_period=0.05, grasp="link1 0.02 0 0"):
        command = peer.publisher("mechanism/handle/set_operational_point", PoseStamped)
        for bad in (
            grasp(peer, "link9"),
            grasp(peer, ""),
            grasp(peer, "link3", float("nan")),
            grasp(peer, "link3", 1e4),
            peer.pose(w=0.5, frame="link3"),
        ):
            refuses(peer, statuses, "mechanism_simulator", command, bad)
        peer.until(lambda: told, "where the point is")
    assert {message.header.frame_id for message in told} == {"link1"}


@pytest.mark.alone
def test_the_hand_feels_no_bump(
    domain: int, peer: Peer, statuses: Statuses, tmp_path: Path
) -> None:
    commands = peer.listen("device/servo_cf", WrenchStamped)
    models = peer.listen("analysis/handle/operational_model", Float64MultiArray)
    frames = peer.listen("view/frames", TransformStamped)

    def parent() -> str:
        """Return what the handle's newest frame that came is on."""
        return next(f.header.frame_id for f in reversed(frames) if f.child_frame_id == "handle")

    # Patient nodes: what is asked here is not how soon a starved machine lets go.
    patience = {"input_timeout": 0.5, "command_timeout": 0.5, "message_age_limit": 1.0}
    names = ",".join([*NODES, "scene_viewer"])
    scene = allowing(tmp_path, command_timeout=0.5)
    # At 1 kHz: what a step of the force may be is of that.
    with running(names, domain, scene, diagnostics_period=0.05, control_rate=0.0, **patience):
        command = peer.publisher("mechanism/handle/set_operational_point", PoseStamped)
        # The hand begins 0.25 s after its device, which is a bump of its own.
        peer.until(lambda: commands and six(commands[-1])[0] > 0.1, "a hand that pushes")
        peer.until_more(commands, 100, "the end of that bump")
        before = len(commands)
        command.publish(grasp(peer, "link1", 0.02, 0.01))
        controller = "teleoperation_controller"
        peer.until(lambda: statuses.figure(controller, "grasps") == "1", "the new grasp")
        # From there on: a starved peer reads later what was sent before.
        peer.until_more(commands, 600, "its closing")
        peer.until(lambda: parent() == "link1", "the handle's frame on the new link")
        peer.until(lambda: six(commands[-1])[0] > 0.1, "the hand held again")
        assert figures(statuses[controller])["engagements"] == "1"
    steps = [
        np.linalg.norm(np.subtract(six(late)[:3], six(early)[:3]))
        for early, late in pairwise(commands[before:])
        if stamp_ns(late.header) - stamp_ns(early.header) < 5_000_000
    ]
    assert len(steps) > 300
    assert max(steps) < BUMP_N
    found = read(OperationalModelMessage, models[-1].data)
    assert found.grasp[0] == 0.0
    # A link on a pin in the world: one direction is free, where the handle had two.
    assert np.count_nonzero(found.s > 1e-6) == 1
