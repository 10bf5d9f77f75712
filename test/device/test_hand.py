# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The hand's laws: constant push, and a spring and damper to a target that moves smoothly."""

import numpy as np
import pinocchio as pin
import pytest

from hapticmech_ros.scene.device import Device
from hapticmech_ros.scene.hand import ConstantWrenchHand, SpringDamperHand, Waypoint
from oracles.devices import body_of, law_of, run

HELD = pin.SE3(pin.exp3(np.array([0.2, 0.1, -0.4])), np.array([0.3, 0.0, 0.1]))
STILL = np.zeros(6)
WAY = (
    Waypoint(time=0.2, xyz=(0.01, 0.0, 0.0), rotation=(0.4, 0.0, 0.0)),
    Waypoint(time=0.7, xyz=(0.03, -0.02, 0.01), rotation=(0.4, 0.9, -0.3)),
    Waypoint(time=1.0, xyz=(0.0, 0.05, 0.0), rotation=(0.0, 0.0, 1.0)),
)


def spring(damping, waypoints=WAY, start_delay=0.25):
    return SpringDamperHand(
        kind="spring_damper",
        stiffness=1.0,
        angular_stiffness=1.0,
        damping=damping,
        angular_damping=damping,
        waypoints=waypoints,
        start_delay=start_delay,
    )


def target(time):
    """Return the target's pose and twist at ``time`` after the start, read from the law alone."""
    elapsed = time + 0.25
    stretch = law_of(spring(0.0))(elapsed, HELD, STILL, HELD)
    rate = law_of(spring(1.0))(elapsed, HELD, STILL, HELD) - stretch
    turned = pin.exp3(stretch[3:]) @ HELD.rotation
    return pin.SE3(turned, HELD.translation + stretch[:3]), rate


def test_a_constant_hand_waits_and_then_pushes():
    hand = ConstantWrenchHand(
        kind="constant_wrench", force=(1.0, 2.0, 3.0), torque=(4.0, 5.0, 6.0), start_delay=0.25
    )
    law = law_of(hand)
    # 249 and 250 periods of 1 ms.
    assert np.array_equal(law(249 * 0.001, HELD, STILL, HELD), np.zeros(6))
    assert np.array_equal(law(250 * 0.001, HELD, STILL, HELD), np.arange(1.0, 7.0))


def test_a_spring_hand_does_not_hold_before_it_starts():
    law = law_of(spring(5.0))
    assert np.array_equal(law(0.2, pin.SE3.Identity(), np.ones(6), HELD), np.zeros(6))


def test_the_target_passes_its_waypoints_and_rests_at_them():
    for waypoint in WAY:
        pose, twist = target(waypoint.time)
        assert np.abs(pose.translation - HELD.translation - waypoint.xyz).max() < 1e-14
        expected = pin.exp3(np.array(waypoint.rotation)) @ HELD.rotation
        assert np.abs(pose.rotation - expected).max() < 1e-13
        assert np.abs(twist).max() < 1e-12
    late, twist = target(9.0)
    assert np.abs(late.translation - HELD.translation - WAY[-1].xyz).max() < 1e-14
    assert np.array_equal(twist, np.zeros(6))


@pytest.mark.parametrize("time", [0.05, 0.1, 0.3, 0.45, 0.6, 0.8, 0.95])
def test_the_target_s_twist_is_the_derivative_of_its_pose(time):
    step = 1e-5
    (before, _), (_, twist), (after, _) = target(time - step), target(time), target(time + step)
    linear = (after.translation - before.translation) / (2.0 * step)
    angular = pin.log3(after.rotation @ before.rotation.T) / (2.0 * step)
    # Central difference: step²/6 times third derivatives of up to 60 / (0.2 s)³ rad/s³ is 1e-7.
    assert np.abs(np.concatenate((linear, angular)) - twist).max() < 1e-6
    assert np.linalg.norm(twist) > 1e-3


def test_between_waypoints_the_target_moves_with_minimum_jerk():
    # Half way in time is half way in space, at 15/8 of the mean speed.
    pose, twist = target(0.45)
    way = np.array(WAY[1].xyz) - np.array(WAY[0].xyz)
    assert np.abs(pose.translation - HELD.translation - WAY[0].xyz - way / 2.0).max() < 1e-14
    assert np.abs(twist[:3] - 15.0 / 8.0 * way / 0.5).max() < 1e-12


def test_spring_and_damper_have_their_coefficients():
    hand = SpringDamperHand(
        kind="spring_damper",
        stiffness=200.0,
        damping=3.0,
        angular_stiffness=0.5,
        angular_damping=0.02,
        waypoints=(Waypoint(time=0.0),),
        start_delay=0.0,
    )
    twist = np.arange(1.0, 7.0)
    away = pin.SE3(pin.exp3(np.array([0, 0, 0.1])) @ HELD.rotation, HELD.translation + 0.01)
    wrench = law_of(hand)(1.0, away, twist, HELD)
    expected = -200.0 * np.array([0.01] * 3) - 3.0 * twist[:3]
    assert np.abs(wrench[:3] - expected).max() < 1e-12
    assert np.abs(wrench[3:] + 0.5 * np.array([0, 0, 0.1]) + 0.02 * twist[3:]).max() < 1e-12


def test_a_held_device_settles_at_the_last_waypoint():
    hand = SpringDamperHand(
        kind="spring_damper",
        damping=10.0,
        angular_damping=0.03,
        waypoints=(Waypoint(time=0.5, xyz=(0.02, -0.01, 0.03), rotation=(0.3, -0.2, 0.5)),),
        start_delay=0.1,
    )
    body = body_of(Device(mass=0.3, inertia=3e-4), hand)
    state = run(body, 2500, start=body.at_rest(HELD, held=True))[-1]
    # Both decay with 10/(2 · 0.3) = 17 1/s; 1.9 s after the move that is e^-32 of some mm.
    goal = HELD.translation + np.array([0.02, -0.01, 0.03])
    assert np.abs(state.pose.translation - goal).max() < 1e-12
    turned = pin.exp3(np.array([0.3, -0.2, 0.5])) @ HELD.rotation
    assert np.abs(state.pose.rotation - turned).max() < 1e-12
    assert np.abs(state.twist).max() < 1e-12


def test_a_hand_starts_at_its_first_waypoint_when_its_time_is_rounded_down():
    at_once = spring(5.0, (Waypoint(time=0.0, xyz=(0.01, 0.0, 0.0)),), start_delay=0.3)
    wrench = law_of(at_once)(0.3 - 1e-16, HELD, STILL, HELD)
    assert np.abs(wrench[:3] - [0.01, 0.0, 0.0]).max() < 1e-15
