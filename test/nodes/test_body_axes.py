# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Commands in a device's own axes: said where these are known, and not otherwise."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest
from rclpy.serialization import serialize_message
from std_msgs.msg import Bool

from benchmarks.reliability.fake_graph import ACTORS, FakeGraph
from hapticmech_ros.nodes.haptic_device import HapticDevice
from hapticmech_ros.wire.wrench import encode_wrench
from nodes.stand_ins import applied
from ros.harness import scene_like

IN_ITS_AXES = "device.servo_axes=body"


def test_where_no_pose_was_heard_nothing_is_said_in_its_axes(tmp_path):
    """A device with ``device/state`` is not heard by its poses, and is commanded in the world's."""
    graph = FakeGraph(scene_like(tmp_path, "five_bar", IN_ITS_AXES), actors=ACTORS[:4])
    graph.run(0.5)
    assert np.linalg.norm(applied(graph)[:3]) > 0.1
    assert "/device/body/servo_cf" not in graph.last


WRENCH = np.array([0.3, -0.2, 0.1, 2e-3, 1e-3, -1e-3])


@pytest.fixture
def alone():
    """The simulated device without the other nodes, turned by its place on a spatial arm."""
    graph = FakeGraph("spatial_arm", actors=[HapticDevice])
    graph.run(0.05)
    assert np.abs(pose_of(graph).rotation - np.eye(3)).max() > 0.1
    return graph


def pose_of(graph):
    return pin.SE3(graph.actor("haptic_device")._state.measured_pose)


def commanded(graph, topic, seconds=0.3):
    """Command a wrench until all limits let it through; return axes and actuators then."""
    for _ in range(round(1000 * seconds)):
        graph.put(topic, encode_wrench(WRENCH, graph.now_ns))
        graph.run(1e-3)
        axes = pose_of(graph).rotation.copy()
    # What acts came with the sample before.
    return axes, applied(graph)


def test_a_device_obeys_wrenches_in_its_own_axes(alone):
    axes, found = commanded(alone, "/device/body/servo_cf")
    expected = np.concatenate([axes @ WRENCH[:3], axes @ WRENCH[3:]])
    # The device turns a little from sample to sample.
    np.testing.assert_allclose(found, expected, atol=0.02 * np.abs(expected).max())
    assert np.abs(found - WRENCH).max() > 0.1 * np.abs(WRENCH).max()


def test_such_wrenches_have_the_axes_of_the_world_on_request(alone):
    alone.put("/device/body/set_cf_orientation_absolute", serialize_message(Bool(data=True)))
    _, found = commanded(alone, "/device/body/servo_cf")
    np.testing.assert_allclose(found, WRENCH, atol=1e-12)


def test_one_form_is_obeyed_at_a_time(alone):
    commanded(alone, "/device/servo_cf")
    host = alone.hosts["haptic_device"]
    alone.put("/device/body/servo_cf", encode_wrench(-WRENCH, alone.now_ns))
    assert host.refused == 1
    assert "while device/servo_cf is obeyed" in host.last_refusal
    _, found = commanded(alone, "/device/servo_cf", 0.02)
    np.testing.assert_allclose(found, WRENCH, atol=1e-12)
    # When one has lapsed, the other may speak.
    alone.run(0.1)
    assert not applied(alone).any()
    commanded(alone, "/device/body/servo_cf")
    assert host.refused == 1


def test_where_the_controller_speaks_both_forms_the_device_hears_one(tmp_path):
    graph = FakeGraph(scene_like(tmp_path, "spatial_arm", IN_ITS_AXES), actors=[HapticDevice])
    names = [name for name, _ in graph.listened()]
    assert "/device/servo_cf" in names
    assert "/device/body/servo_cf" not in names
