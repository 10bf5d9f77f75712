# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The simulated device without the other nodes: a client commands it, and an arm holds it."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.reliability.fake_graph import FakeGraph
from hapticmech_ros.nodes.haptic_device import HapticDevice
from hapticmech_ros.scene.hand import STILL_HAND
from hapticmech_ros.wire.messages import DeviceStateMessage
from hapticmech_ros.wire.wrench import encode_wrench


def moved(graph, force, seconds):
    """Command a constant force (N) for a while; return positions from the start, per ms."""
    wrench = np.array([force, 0.0, 0.0, 0.0, 0.0, 0.0])
    places = []
    for _ in range(round(1000 * seconds)):
        graph.put("/device/servo_cf", encode_wrench(wrench, graph.now_ns))
        graph.run(1e-3)
        places.append(sample(graph, "position"))
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


def sample(graph, name):
    """Return a part of the device's last sample."""
    values = np.frombuffer(graph.last["/device/state"][-8 * DeviceStateMessage.layout.size :])
    return values[DeviceStateMessage.layout.slice(name)]


@pytest.mark.parametrize(
    ("topic", "timeout", "acts"),
    [("servo_cf", "command_timeout", "applied"), ("hand_cf", "hand_timeout", "hand_wrench")],
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
            stood[-1] += bool(sample(graph, acts).any())
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
