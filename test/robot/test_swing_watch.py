# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A robot that carries more than its rates bear is noticed, slowed down, and keeps its target."""

import numpy as np
import pinocchio as pin

from hapticmech_ros.robot.follower import Follower, FollowerSettings, SwingWatch
from hapticmech_ros.robot.law import Gains
from hapticmech_ros.robot.mujoco_robot import Around, MujocoRobot, Unmodelled
from oracles.driven_robots import law_of, pose_of, robot

Q = np.array([0.0, -1.9, 1.9, -0.5, -1.0, 0.0])
PERIOD, LEVER, WINDOW = 1e-3, 0.1, 0.7


def watched(motion, seconds=1.0):
    """Return whether a motion, twist by time, is taken for a swing."""
    watch = SwingWatch(0.05, LEVER, WINDOW)
    times = PERIOD * np.arange(round(seconds / PERIOD))
    return any(watch.swings(motion(float(time)), float(time)) for time in times)


def test_what_turns_round_again_and_again_is_a_swing():
    way = np.array([0.6, -0.8, 0.0, 0.0, 0.0, 0.0])
    turn = np.array([0.0, 0.0, 0.0, 0.0, 0.6, 0.8]) / LEVER
    for along in (way, turn):
        assert watched(lambda t, along=along: 0.06 * np.sin(40.0 * t) * along)
        assert not watched(lambda t, along=along: 0.04 * np.sin(40.0 * t) * along)
        # Three periods take 0.94 s.
        assert not watched(lambda t, along=along: 0.06 * np.sin(20.0 * t) * along)


def test_an_impact_and_a_robot_that_lags_are_no_swing():
    way = np.array([1.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    assert not watched(lambda t: 0.5 * way)
    # A robot that bounces off a wall and settles.
    assert not watched(lambda t: 0.5 * np.exp(-20.0 * t) * np.cos(30.0 * t) * way)


def driven(payload, swing_speed, interface="effort"):
    """Return the follower's counts and the errors, m, of a UR5e with a payload 0.1 m beyond."""
    law = law_of("ur5e", gains=Gains(linear_rate=120.0, angular_rate=120.0))
    carrying = Around(unmodelled=Unmodelled(payload=payload, beyond=0.1))
    moved = MujocoRobot(robot("ur5e").scene, around=carrying, step=PERIOD / 2)
    moved.put(Q, np.zeros(6))
    settings = FollowerSettings(
        interface, PERIOD, has_sensor=True, observer_rate=120.0, swing_speed=swing_speed
    )
    follower, pose, errors = Follower(law, settings), pose_of(law, Q), []
    torque, start = law.resting(Q), moved.pose.translation.copy()
    # 2 mm away, with nothing else that disturbs it: the scene has no weight.
    begin = pin.SE3(pose.rotation, pose.translation - np.array([0.0, 0.0, 0.002]))
    for tick in range(2000):
        time = PERIOD * tick
        follower.update_joints(moved.q, moved.v, time)
        follower.update_target(begin if tick == 0 else pose, np.zeros(6), time)
        follower.update_wrench(np.zeros(6), time)
        order = follower.order(time)
        moved.advance(torque, 2)
        torque = order.values
        way = moved.pose.translation - start - (pose.translation - begin.translation)
        errors.append(float(np.linalg.norm(way)))
    return follower.counts, np.array(errors)


def test_a_robot_that_swings_is_slowed_down_and_comes_to_rest():
    """1.5 kg make 14 times its inertia of the wrist, where κ = ω bears 6."""
    counts, errors = driven(1.5, 0.05)
    assert counts.swings == 1
    assert counts.followed == counts.orders
    assert errors[-100:].max() < 0.05 * errors.max()
    counts, errors = driven(1.5, 0.0)
    assert counts.swings == 0
    # The swing does not end.
    assert errors[-100:].max() > 0.02


def test_a_payload_that_is_borne_changes_nothing():
    counts, errors = driven(0.5, 0.05)
    assert counts.swings == 0
    # A share of exp(-κ t) of 2 mm, and what a swing of 5 times the inertia leaves.
    assert errors[-100:].max() < 1e-5
