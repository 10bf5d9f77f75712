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
        graph.tick()
        graph.tick()
        values = np.frombuffer(graph.last["/device/state"][-8 * DeviceStateMessage.layout.size :])
        places.append(values[DeviceStateMessage.layout.slice("position")])
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
