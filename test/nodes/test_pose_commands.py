# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""CRTK's servo_cp, hold and free: the device alone is pulled to a pose by a spring and damper."""

from __future__ import annotations

import re

import numpy as np
import pinocchio as pin
import pytest
from geometry_msgs.msg import PoseStamped
from rclpy.serialization import deserialize_message, serialize_message
from std_msgs.msg import Empty
from std_srvs.srv import SetBool

from benchmarks.reliability.fake_graph import ACTORS, FakeGraph
from hapticmech_ros.control.measurements import device_of
from hapticmech_ros.device.safety import ANGULAR_STIFFNESS, STIFFNESS, PositionServo, safety_limits
from hapticmech_ros.errors import SceneError
from hapticmech_ros.loading import load_scene
from hapticmech_ros.nodes.haptic_device import HapticDevice
from hapticmech_ros.numerics.quaternions import quaternion_of
from hapticmech_ros.scene.device import SERVO_ANGLE, Device, device_presets
from hapticmech_ros.wire.topics import EMERGENCY_STOP
from hapticmech_ros.wire.wrench import encode_wrench
from nodes.stand_ins import applied, last_sample
from ros.harness import scene_like

PUSH = np.array([1.0, -0.5, 0.0, 0.0, 0.0, 2e-3])


def pushed(graph, seconds, wrench=PUSH, command=None):
    """Push the device's handle for a while, and command by ``command``, if given, each period."""
    for _ in range(round(1000 * seconds)):
        graph.put("/device/hand_cf", encode_wrench(wrench, graph.now_ns))
        if command is not None:
            command()
        graph.run(1e-3)


def state(graph):
    return pin.SE3(device_of(last_sample(graph).sample.values).pose)


def pose_message(pose, frame="world"):
    message = PoseStamped()
    message.header.frame_id = frame
    message.pose.position.x, message.pose.position.y, message.pose.position.z = pose.translation
    o = message.pose.orientation
    o.x, o.y, o.z, o.w = quaternion_of(pose.rotation).tolist()
    return serialize_message(message)


def say(graph, word):
    graph.put(f"/device/{word}", serialize_message(Empty()))


def begun(scene="five_bar", **parameters):
    """Return a device without the other nodes, whose hand does what it is told."""
    given = {"haptic_device": {"hand": "commanded", **parameters}}
    graph = FakeGraph(scene, actors=[HapticDevice], parameters=given)
    graph.run(0.1)
    return graph


@pytest.fixture
def held():
    graph = begun()
    say(graph, "hold")
    return graph


def test_a_held_device_gives_way_to_a_push_by_its_stiffness_and_comes_back(held):
    """The spring's own law, at rest: K e = F, in each direction."""
    before = state(held)
    pushed(held, 3.0)
    moved = state(held)
    away = moved.translation - before.translation
    turned = pin.log3(moved.rotation @ before.rotation.T)
    np.testing.assert_allclose(away, PUSH[:3] / STIFFNESS, rtol=1e-4, atol=1e-9)
    np.testing.assert_allclose(turned, PUSH[3:] / ANGULAR_STIFFNESS, rtol=1e-4, atol=1e-9)
    np.testing.assert_allclose(applied(held), -PUSH, rtol=1e-4, atol=1e-7)
    pushed(held, 3.0, np.zeros(6))
    assert np.abs((before.inverse() * state(held)).translation).max() < 1e-6


def test_it_swings_as_a_damped_oscillator(held):
    """x(t) of m ẍ + b ẋ + k x = F, ζ = 0.7, to within the period of the sampling."""
    device = load_scene("five_bar").device
    mass, stiffness, ratio = device.mass, STIFFNESS, device.servo.damping_ratio
    pushed(held, 0.3, np.zeros(6))
    start = state(held).translation[0]
    found = []
    for _ in range(300):
        pushed(held, 1e-3)
        found.append(state(held).translation[0] - start)
    rate = np.sqrt(stiffness / mass)
    damped = rate * np.sqrt(1.0 - ratio**2)
    time = 1e-3 * np.arange(1, 301)
    phase = np.cos(damped * time) + ratio * rate / damped * np.sin(damped * time)
    expected = PUSH[0] / stiffness * (1.0 - np.exp(-ratio * rate * time) * phase)
    assert np.abs(np.array(found) - expected).max() < 0.06 * PUSH[0] / stiffness


def test_free_ends_a_hold_with_no_force_at_once(held):
    pushed(held, 0.5)
    assert np.abs(applied(held)[:3]).max() > 0.5
    say(held, "free")
    assert np.abs(applied(held)).max() == 0.0
    pushed(held, 0.5)
    assert np.abs(applied(held)).max() == 0.0
    assert np.linalg.norm(state(held).translation) > 0.1


def test_a_second_hold_changes_nothing_and_a_hold_lasts(held):
    before = state(held)
    pushed(held, 1.0)
    say(held, "hold")
    pushed(held, 2.0, np.zeros(6))
    assert np.abs((before.inverse() * state(held)).translation).max() < 1e-5


def test_a_commanded_pose_is_reached_and_published():
    graph = begun()
    start = state(graph)
    goal = pin.SE3(start.rotation @ pin.exp3(np.array([0.0, 0.0, 0.3])), start.translation + 0.01)
    goal.translation[2] = start.translation[2]
    command = lambda: graph.put("/device/servo_cp", pose_message(goal))  # noqa: E731
    pushed(graph, 3.0, np.zeros(6), command)
    assert np.abs(pin.log6(goal.actInv(state(graph))).vector).max() < 1e-5
    shown = deserialize_message(graph.last["/device/setpoint_cp"], PoseStamped).pose.position
    np.testing.assert_allclose([shown.x, shown.y, shown.z], goal.translation, atol=1e-12)
    # What is not renewed runs out: no force, within the timeout.
    pushed(graph, 0.03, PUSH)
    assert np.abs(applied(graph)).max() == 0.0
    assert any("servo_cp is lost" in text for _, text in graph.hosts["haptic_device"].log.lines)


def test_no_pose_is_obeyed_while_wrenches_are_and_the_other_way_round():
    graph = begun()
    host, here = graph.hosts["haptic_device"], state(graph)
    wrench = lambda: graph.put("/device/servo_cf", encode_wrench(PUSH, graph.now_ns))  # noqa: E731
    pushed(graph, 0.2, -PUSH, wrench)
    for word, act in (
        ("hold", lambda: say(graph, "hold")),
        ("free", lambda: say(graph, "free")),
        ("servo_cp", lambda: graph.put("/device/servo_cp", pose_message(here))),
    ):
        before = host.refused
        wrench()
        act()
        assert host.refused == before + 1
        assert word in host.last_refusal
        assert "one kind of command at a time" in host.last_refusal
    graph.run(0.1)
    before = host.refused
    pushed(graph, 0.05, np.zeros(6), lambda: graph.put("/device/servo_cp", pose_message(here)))
    wrench()
    assert host.refused == before + 1
    assert "servo_cp" in host.last_refusal


def test_a_wrench_ends_a_hold(held):
    pushed(held, 0.2)
    wrench = lambda: held.put("/device/servo_cf", encode_wrench(-PUSH, held.now_ns))  # noqa: E731
    pushed(held, 1.0, PUSH, wrench)
    np.testing.assert_allclose(applied(held), -PUSH, atol=1e-9)
    # Silence after it is no hold again.
    pushed(held, 0.1)
    assert np.abs(applied(held)).max() == 0.0


@pytest.mark.parametrize("how", ["stop", "pause", "deactivate"])
def test_whatever_stops_the_device_ends_a_hold(held, how):
    pushed(held, 0.5)
    host = held.hosts["haptic_device"]
    if how == "stop":
        host.services[EMERGENCY_STOP](SetBool.Request(data=True), SetBool.Response())
    elif how == "pause":
        host.actor._operating._pause()
    else:
        host.end()
        host.begin()
    pushed(held, 0.1)
    assert np.abs(applied(held)).max() == 0.0
    if how == "stop":
        host.services[EMERGENCY_STOP](SetBool.Request(data=False), SetBool.Response())
    elif how == "pause":
        host.actor._operating._resume()
    pushed(held, 0.1)
    assert np.abs(applied(held)).max() == 0.0


@pytest.mark.parametrize("word", ["hold", "servo_cp"])
def test_a_paused_device_refuses_poses_and_says_why(word):
    graph = begun()
    host = graph.hosts["haptic_device"]
    host.actor._operating._pause()
    before = len(host.log.lines)
    for _ in range(100):
        if word == "hold":
            say(graph, "hold")
        else:
            graph.put("/device/servo_cp", pose_message(state(graph)))
        graph.tick()
    assert host.refused == 100
    assert "paused" in host.last_refusal
    assert np.abs(applied(graph)).max() == 0.0
    # Refusals are counted, and not logged one by one.
    assert len(host.log.lines) - before < 5
    host.actor._operating._resume()
    say(graph, "hold")
    pushed(graph, 0.3)
    assert np.abs(applied(graph)[:3]).max() > 0.5


@pytest.mark.parametrize(
    ("message", "rule"),
    [
        (pose_message(pin.SE3.Identity(), "map"), "must be 'world', or empty"),
        (pose_message(pin.SE3(np.eye(3), np.array([np.nan, 0.0, 0.0]))), "finite"),
        (pose_message(pin.SE3(np.eye(3), np.array([1e9, 0.0, 0.0]))), "position"),
    ],
)
def test_a_pose_that_breaks_a_rule_is_refused_and_moves_nothing(message, rule):
    graph = begun()
    graph.put("/device/servo_cp", message)
    graph.run(0.05)
    assert graph.hosts["haptic_device"].refused == 1
    assert rule in graph.hosts["haptic_device"].last_refusal
    assert np.abs(applied(graph)).max() == 0.0


def test_forces_of_a_hold_keep_within_the_device_s_limits():
    graph = begun(force_limit=2.0, start_ramp=0.2)
    start = state(graph)
    far = pin.SE3(start.rotation, start.translation + np.array([0.5, 0.0, 0.0]))
    forces = []
    for _ in range(400):
        graph.put("/device/servo_cp", pose_message(far))
        graph.run(1e-3)
        forces.append(np.linalg.norm(applied(graph)[:3]))
    assert max(forces) <= 2.0 + 1e-9
    # The limit opens with the ramp.
    assert all(force <= 2.0 * (k + 2) / 200 + 1e-9 for k, force in enumerate(forces[:150]))


def test_the_whole_graph_goes_on_while_a_client_asks_for_a_hold():
    graph = FakeGraph("five_bar", actors=ACTORS[:4])
    graph.run(0.5)
    before = graph.hosts["haptic_device"].refused
    say(graph, "hold")
    graph.run(0.2)
    assert graph.hosts["haptic_device"].refused == before + 1
    assert np.linalg.norm(applied(graph)[:3]) > 0.1


def test_the_law_is_the_springs_in_rotation_too():
    """A rotation about a slanted axis pulls back about that axis."""
    servo = PositionServo(Device(), 1e-3, safety_limits(Device()))
    turn = np.array([0.1, -0.2, 0.3])
    pose = pin.SE3(pin.exp3(np.array([1.0, 2.0, -0.5])), np.array([0.3, 0.2, 0.1]))
    goal = pin.SE3(pin.exp3(turn) @ pose.rotation, pose.translation + np.array([0.01, 0.0, -0.02]))
    found = servo.wrench(goal, pose, np.zeros(6))
    np.testing.assert_allclose(found[:3], 200.0 * np.array([0.01, 0.0, -0.02]), atol=1e-12)
    np.testing.assert_allclose(found[3:], 0.1 * turn, atol=1e-12)
    twist = np.array([0.1, 0.0, 0.0, 0.0, 0.0, 2.0])
    damped = servo.wrench(pose, pose, twist)
    np.testing.assert_allclose(damped[0], -1.4 * np.sqrt(200.0 * 0.3) * 0.1)
    np.testing.assert_allclose(damped[5], -1.4 * np.sqrt(0.1 * 3e-4) * 2.0)


@pytest.mark.parametrize("rate", [50.0, 200.0, 1000.0, 4000.0])
@pytest.mark.parametrize("preset", sorted(device_presets()))
def test_what_is_left_out_is_what_samples_can_hold(preset, rate):
    device = Device(preset=preset)
    safety = device.safety
    servo = PositionServo(device, 1.0 / rate, safety_limits(device))
    away = pin.SE3(pin.exp3(np.array([0.0, 0.0, 1.0])), np.ones(3))
    found = servo.wrench(away, pin.SE3.Identity(), np.zeros(6))
    for stiffness, inertia, most, ratio in (
        (found[0], device.mass, STIFFNESS, safety.force_slew / device.force_limit),
        (found[5], device.inertia, ANGULAR_STIFFNESS, safety.torque_slew / device.torque_limit),
    ):
        allowed = min(SERVO_ANGLE * rate, ratio) ** 2 * inertia
        assert stiffness == pytest.approx(min(most, allowed))


@pytest.mark.parametrize(
    ("change", "key"),
    [
        ("device.servo.stiffness=3100", "device.servo.stiffness"),
        ("device.servo.angular_stiffness=3.1", "device.servo.angular_stiffness"),
        ("device.servo.damping_ratio=0.3", "device.servo.damping_ratio"),
        ("device.servo.damping_ratio=2.1", "device.servo.damping_ratio"),
    ],
)
def test_a_stiffness_that_cannot_be_held_is_refused(change, key):
    with pytest.raises(SceneError, match=re.escape(key)):
        load_scene("five_bar", changes=[change])


@pytest.mark.parametrize("ratio", [0.4, 0.7, 2.0])
@pytest.mark.parametrize("slew", [2000.0, 1e6])
def test_the_stiffest_that_is_allowed_comes_to_rest_after_a_push(tmp_path, ratio, slew):
    """Bounded by the slew limit, and by the period where that limit is far.

    The push drives the force to its limit while the start's ramp holds it back.
    """
    device = load_scene("five_bar").device
    rate = 0.999 * min(SERVO_ANGLE / 1e-3, slew / device.force_limit)
    changes = [
        f"device.safety.force_slew={slew}",
        f"device.servo.stiffness={rate**2 * device.mass}",
        f"device.servo.damping_ratio={ratio}",
    ]
    graph = begun(scene_like(tmp_path, "five_bar", *changes))
    say(graph, "hold")
    before = state(graph)
    pushed(graph, 0.5, 8.0 * PUSH)
    pushed(graph, 1.5, np.zeros(6))
    assert np.abs((before.inverse() * state(graph)).translation).max() < 1e-8


def test_a_slower_slew_limit_of_the_node_makes_it_less_stiff():
    """So that it stays stable with whatever the node's parameters allow."""
    device = load_scene("five_bar").device
    graph = begun(force_slew=100.0)
    say(graph, "hold")
    before = state(graph)
    pushed(graph, 5.0, 0.5 * PUSH)
    away = (state(graph).translation - before.translation)[0]
    stiffness = min(STIFFNESS, (100.0 / device.force_limit) ** 2 * device.mass)
    assert away == pytest.approx(0.5 * PUSH[0] / stiffness, rel=0.02)
