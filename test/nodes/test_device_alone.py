# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The simulated device without the other nodes: a client commands it, and an arm holds it."""

from __future__ import annotations

import math
from operator import attrgetter

import numpy as np
import pytest

from benchmarks.reliability.fake_graph import FakeGraph
from hapticmech_ros import Session, load_scene
from hapticmech_ros.nodes.haptic_device import HapticDevice
from hapticmech_ros.scene.hand import STILL_HAND
from hapticmech_ros.wire.wrench import encode_wrench
from nodes.stand_ins import heard, last_sample, push
from ros.harness import allowing, scene_like, six


def moved(graph, force, seconds):
    """Command a constant force (N) for a while; return positions from the start, per ms."""
    wrench = np.array([force, 0.0, 0.0, 0.0, 0.0, 0.0])
    places = []
    for _ in range(round(1000 * seconds)):
        graph.put("/device/servo_cf", encode_wrench(wrench, graph.now_ns))
        graph.run(1e-3)
        places.append(last_sample(graph).sample.position.copy())
    return np.array(places) - places[0]


@pytest.mark.parametrize("force", [0.0, 1.0, 3.0])
def test_a_relaxed_arm_gives_way_to_a_force_and_holds(force):
    parameters = {"haptic_device": {"hand": "still"}}
    graph = FakeGraph("five_bar", actors=[HapticDevice], parameters=parameters)
    places = moved(graph, force, 5.0)
    expected = force / STILL_HAND.stiffness
    assert places[-1, 0] == pytest.approx(expected, abs=1e-3 * max(expected, 1e-3))
    assert np.abs(places[-1, 1:]).max() < 1e-9
    # It overshoots less than twice, as whatever is damped does.
    assert np.abs(places[:, 0]).max() <= 2.0 * expected + 1e-12
    assert np.ptp(places[-500:, 0]) <= 1e-3 * max(expected, 1e-6)


def test_the_scene_s_hand_alone_pushes_the_device_away():
    graph = FakeGraph("five_bar", actors=[HapticDevice])
    assert np.abs(moved(graph, 0.0, 3.0)[-1]).max() > 0.5


@pytest.mark.parametrize(
    ("topic", "timeout", "acts"),
    [("servo_cf", "command_timeout", "applied"), ("hand_cf", "hand_timeout", "sample.hand_wrench")],
)
def test_a_wrench_stands_as_long_as_a_parameter_says_that_can_change(topic, timeout, acts):
    given = {"haptic_device": {"hand": "commanded", timeout: 0.02}}
    graph = FakeGraph("five_bar", actors=[HapticDevice], parameters=given)
    actor, stood = graph.actor("haptic_device"), []
    for seconds in (0.02, 0.05):
        actor.apply_parameters(actor.parameters.model_copy(update={timeout: seconds}))
        graph.put(f"/device/{topic}", encode_wrench(np.full(6, 1e-3), graph.now_ns))
        stood.append(0)
        for _ in range(400):
            graph.run(1e-3)
            stood[-1] += bool(attrgetter(acts)(last_sample(graph)).any())
    assert 18 <= stood[0] < 300
    assert stood[1] - stood[0] == 30


def test_how_often_people_are_told_is_a_parameter_that_can_change():
    graph = FakeGraph("five_bar", actors=[HapticDevice])
    actor, sent, told = graph.actor("haptic_device"), graph.sent, []
    graph.sent = lambda topic, *message: (told.append(topic), sent(topic, *message))
    for rate in (100.0, 20.0):
        actor.apply_parameters(actor.parameters.model_copy(update={"view_rate": rate}))
        graph.run(0.1)
        told.clear()
        graph.run(1.0)
        assert told.count("/device/measured_cp") == pytest.approx(rate, abs=1)


# Nothing moves it, and people are told of every sample.
QUICK = {"haptic_device": {"wait_for_start": True, "view_rate": 1000.0}}


def test_it_measures_pose_twist_and_hand_wrench_in_world():
    graph = FakeGraph("five_bar", actors=[HapticDevice], parameters=QUICK)
    names = "measured_cp", "measured_cv", "hand/measured_cf"
    streams = heard(graph, *(f"/device/{name}" for name in names))
    graph.run(0.05)
    start = Session(load_scene("five_bar")).tick().point.pose.translation
    for number in (0, -1):
        pose, twist, force = (stream[number] for stream in streams)
        position = pose.pose.position
        # The device starts at the operational point and nothing pushes it: equal to the last bit
        # but for the scene's own closing to 1e-12.
        assert math.dist((position.x, position.y, position.z), start) < 1e-11
        assert six(twist) == six(force) == [0.0] * 6
        # One sample has one stamp, whichever of its messages is heard.
        assert pose.header == twist.header == force.header
        assert pose.header.frame_id == "world"


def test_compensation_begins_and_ends_with_the_commands(tmp_path):
    weight = {"compensation": {"gravity": True}, "gravity_load": [0.0, -0.4, 0.0]}
    scene = scene_like(tmp_path, "five_bar", device={**weight, "coulomb_friction": 0.5})
    graph = FakeGraph(scene, actors=[HapticDevice], parameters=QUICK)
    graph.run(0.1)
    assert not last_sample(graph).applied.any()
    moved(graph, 0.0, 0.3)
    assert last_sample(graph).applied.tolist() == [0.0, 0.4, 0.0, 0.0, 0.0, 0.0]
    graph.run(0.1)
    assert not last_sample(graph).applied.any()


def test_a_deactivated_device_lets_go_and_begins_anew_where_it_is():
    graph = FakeGraph("five_bar", actors=[HapticDevice])
    host = graph.hosts["haptic_device"]
    moved(graph, 0.5, 0.5)
    before = last_sample(graph)
    assert before.applied.any()
    assert before.sample.hand_wrench.any()
    place = before.sample.position.copy()
    host.end()
    assert not host.actor._state.applied.any()
    last = graph.last["/device/state"]
    # Commands to an inactive device are for nobody, not even for later.
    graph.put("/device/servo_cf", encode_wrench(np.ones(6), graph.now_ns))
    graph.run(0.05)
    assert graph.last["/device/state"] is last
    host.begin()
    for _ in range(100):
        graph.run(1e-3)
        after = last_sample(graph)
        assert not after.applied.any()
        assert not after.sample.hand_wrench.any()
        assert not after.sample.twist.any()
    # It moves on between its last sample and its end by less than the hand can move it.
    assert np.abs(after.sample.position - place).max() < 1e-3
    moved(graph, 0.5, 0.5)
    assert last_sample(graph).sample.hand_wrench.any()


def test_a_push_from_before_it_was_deactivated_is_forgotten():
    given = {"haptic_device": {"hand": "commanded", "hand_timeout": 0.5}}
    graph = FakeGraph("five_bar", actors=[HapticDevice], parameters=given)
    host = graph.hosts["haptic_device"]
    graph.put("/device/hand_cf", encode_wrench(np.full(6, 1e-3), graph.now_ns))
    graph.run(2e-3)
    assert last_sample(graph).sample.hand_wrench.any()
    host.end()
    host.begin()
    graph.run(2e-3)
    assert not last_sample(graph).sample.hand_wrench.any()


def test_limits_slew_ramp_and_workspace_hold_and_are_told(tmp_path):
    limits = {
        "force_limit": 2.0,
        "torque_limit": 0.01,
        # Less than the ramp asks for: 2 N in 0.05 s.
        "force_slew": 20.0,
        "start_ramp": 0.05,
        "workspace_radius": 0.005,
    }
    given = {"haptic_device": {"hand": "commanded", **limits}}
    scene = allowing(tmp_path, start_ramp=0.05)
    graph, applied = FakeGraph(scene, actors=[HapticDevice], parameters=given), []
    for _ in range(500):
        push(graph, "/device/servo_cf", (5.0, 0.0, 0.0, 0.0, 0.0, 0.5))
        graph.run(1e-3)
        applied.append(last_sample(graph).applied.copy())
    forces = np.array(applied)
    steps = np.linalg.norm(np.diff(forces[:, :3], axis=0), axis=1)
    assert 1.5 < np.linalg.norm(forces[:, :3], axis=1).max() <= 2.0 * (1 + 1e-12)
    assert steps[: int(2.0 / 20.0 * 1000) // 2].max() <= 20.0 * 1e-3 * (1 + 1e-9)
    assert np.abs(forces[:, 3:]).max() <= 0.01 * (1 + 1e-12)
    told = graph.actor("haptic_device").status()[2]
    for name in ("force_limit", "force_slew", "workspace"):
        assert int(told[f"limited_by_{name}"]) > 0
