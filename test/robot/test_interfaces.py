# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Positions and velocities for robots that take no torques: the same law, in a virtual robot."""

import numpy as np
import pinocchio as pin
import pytest

from hapticmech_ros.errors import InvalidInputError
from hapticmech_ros.robot.interfaces import VirtualRobot
from hapticmech_ros.robot.law import ForceTask, Gains, Target
from oracles.driven_robots import law_of, pose_of

Q = np.array([0.2, 0.6, -0.3, -1.4, 0.4, 0.9, 0.0])
RATE = 10.0
NO_CONTACT = np.zeros(6)


def virtual(period=1e-3, **options):
    gains = Gains(linear_rate=RATE, angular_rate=RATE, posture_rate=0.0)
    return VirtualRobot(law_of("iiwa14", gains=gains), period, **options)


def error_after(robot, time, start):
    """Return the position's error (3,) after a while, with joints that follow perfectly."""
    pose = pose_of(robot.law, Q)
    target = Target(pin.SE3(pose.rotation, pose.translation + start))
    state = robot.at_rest(Q)
    for _ in range(round(time / robot.period)):
        _, state = robot.next(state, state.q, target, NO_CONTACT)
    return target.pose.translation - pose_of(robot.law, state.q).translation


def test_a_robot_that_follows_its_setpoints_moves_as_the_closed_form_says():
    """e(t) = e_0 (1 + ω t) exp(-ω t), to first order in the period."""
    start, time = np.array([0.03, -0.05, 0.04]), 0.2
    exact = start * (1.0 + RATE * time) * np.exp(-RATE * time)
    coarse, fine = (
        np.linalg.norm(error_after(virtual(period), time, start) - exact) for period in (2e-3, 1e-3)
    )
    assert coarse / fine == pytest.approx(2.0, rel=0.1)
    # Half a step of a motion with ω² |e_0| = 7 m/s² at 10 1/s, for 0.2 s.
    assert fine < 0.5 * 1e-3 * RATE * np.linalg.norm(start)


def test_a_constant_push_displaces_it_by_the_mechanism_over_the_rate():
    """ω² e = -X F_c at rest: at the operational point the robot is as soft as its law."""
    robot = virtual()
    pose = pose_of(robot.law, Q)
    push = np.array([3.0, -2.0, 4.0, 0.02, 0.01, -0.03])
    state = robot.at_rest(Q)
    for _ in range(4000):
        setpoint, state = robot.next(state, state.q, Target(pose), push)
    there = robot.law.state(state.q, np.zeros(7))
    expected = -there.analysis.inverse_inertia @ push / RATE**2
    # What is left of the way there, exp(-ω t) = exp(-40), and of motion in the null space.
    np.testing.assert_allclose(setpoint.command.error, expected, atol=1e-9)
    assert np.linalg.norm(expected) > 1e-3


def test_a_controlled_force_moves_it_until_the_wall_answers():
    """Against a spring k the virtual robot settles where k times the depth is the force."""
    robot = virtual()
    pose = pose_of(robot.law, Q)
    n, force, stiffness = np.array([0.0, 0.0, -1.0]), 12.0, 2000.0
    target = Target(pose, force=ForceTask(n, force))
    state, contact = robot.at_rest(Q), NO_CONTACT
    for _ in range(4000):
        _, state = robot.next(state, state.q, target, contact)
        depth = n @ (pose_of(robot.law, state.q).translation - pose.translation)
        contact = np.r_[-stiffness * max(depth, 0.0) * n, np.zeros(3)]
    # The integral of the force's error decays at 5 1/s: exp(-20) of 12 N.
    assert -(n @ contact[:3]) == pytest.approx(force, abs=1e-6)


def test_velocities_pull_a_robot_that_lags_behind():
    robot = virtual(correction=20.0)
    pose = pose_of(robot.law, Q)
    lag = np.linspace(-0.01, 0.01, 7)
    setpoint, _ = robot.next(robot.at_rest(Q), Q - lag, Target(pose), NO_CONTACT)
    # A pose's rounding, 1e-15, times ω² T.
    np.testing.assert_allclose(setpoint.velocity, 20.0 * lag, atol=1e-12)
    assert not setpoint.leashed


def test_the_virtual_robot_is_held_back_and_it_is_told():
    robot = virtual(leash=0.05)
    state = robot.at_rest(Q + 0.2)
    setpoint, after = robot.next(state, Q, Target(pose_of(robot.law, Q)), NO_CONTACT)
    assert setpoint.leashed
    assert np.abs(after.q - Q).max() < 0.05 + 1e-3 * np.abs(after.v).max() + 1e-12


@pytest.mark.parametrize("name", ["period", "leash", "correction"])
def test_numbers_that_are_none_are_refused(name):
    with pytest.raises(InvalidInputError, match=name):
        VirtualRobot(law_of("iiwa14"), **{"period": 1e-3, name: 0.0})


def test_a_measurement_of_another_size_is_refused():
    robot, target = virtual(), Target(pose_of(law_of("iiwa14"), Q))
    with pytest.raises(InvalidInputError, match="7 finite numbers"):
        robot.next(robot.at_rest(Q), np.zeros(6), target, NO_CONTACT)
