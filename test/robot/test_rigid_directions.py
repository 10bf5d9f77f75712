# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Joints along rigid directions: led where the point can go, braked where it cannot, bounded."""

import numpy as np
import pinocchio as pin
import pytest

from hapticmech_ros.robot.law import COASTING, Gains, Target
from oracles.driven_robots import accelerated, law_of, pose_of

# The UR5e's wrist is singular where joint 5 is at 0.
POSE = np.array([0.1, -1.2, 1.3, -0.9, 0.0, 0.2])
V = np.array([0.3, -0.2, 0.1, 0.4, 0.5, -0.3])
NOTHING = np.zeros(6)
UR5E = law_of("ur5e")
SEEN = UR5E.mechanism.scene.perception


def wrist(angle):
    return np.where(np.arange(6) == 4, angle, POSE)


def along(state, motion):
    """Return the part (t,) along u_i of a motion of joints in the mass metric."""
    return state.shaped.units.T @ motion


def test_a_motion_that_the_robot_can_make_is_accelerated_as_it_is():
    """s² ≫ λ² and no error: y_i = w_i u_iᵀ Lᵀ v̇, without a brake."""
    tiny, vdot = 1e-4 * V, 1e-3 * np.arange(1.0, 7.0)
    angle = 0.5
    while UR5E.state(wrist(angle), V).analysis.spectrum.s[-1] > SEEN.s_on:
        angle *= 0.98
    state = UR5E.state(wrist(angle), tiny)
    jacobian = state.point.jacobian
    given, _ = UR5E.led(state, NOTHING, jacobian @ tiny, jacobian @ vdot)
    expected = along(state, state.factor.T @ vdot)
    assert state.analysis.weights[-1] == pytest.approx(1.0, abs=1e-3)
    # λ² / s² is missing, and of the saturations half the square of 1e-3 / 3.
    kept = 1.0 / (1.0 + (COASTING * SEEN.s_on / state.analysis.spectrum.s[-1]) ** 2)
    assert along(state, given)[-1] == pytest.approx(kept * expected[-1], rel=2e-3)


def test_next_to_the_singular_pose_joints_coast():
    state = UR5E.state(wrist(1e-5), V)
    speed = state.factor.T @ V
    given = along(state, UR5E.led(state, NOTHING, state.point.jacobian @ V, NOTHING)[0])[-1]
    share = (state.analysis.spectrum.s[-1] / (COASTING * SEEN.s_on)) ** 2
    assert share < 1e-2
    # Of a brake that acts at full rate.
    full = UR5E.gains.linear_rate * abs(along(state, speed)[-1])
    assert abs(given) <= 2.0 * share * full


def test_what_cannot_be_reached_is_braked():
    """A straight arm that is called outwards: the rate along u decays, by y = -ω b u̇."""
    law, q = law_of("iiwa14"), np.array([0.3, 0.7, 0.2, 1e-5, 0.4, 0.9, 0.1])
    n = law.state(q, np.zeros(7)).analysis.spectrum.wrenches[:, -1]
    state = law.state(q, np.resize(V, 7))
    speed = state.factor.T @ state.v
    given = along(state, law.led(state, 0.02 * n, NOTHING, NOTHING)[0])[-1]
    # Nothing but the brake, and ε ≫ λ.
    expected = -law.gains.linear_rate * along(state, speed)[-1]
    assert given == pytest.approx(expected, rel=1e-2)


def test_the_damping_is_the_second_derivative_that_newton_has():
    """s_i² - c, c = n_iᵀ e n_iᵀ J̇(w) w, is that of (n_iᵀ e)² / 2 along w, and ε_i² is |c|."""
    law, q = law_of("iiwa14"), np.array([0.3, 0.7, 0.2, 0.02, 0.4, 0.9, 0.1])
    start = law.state(q, np.zeros(7))
    n, w = start.analysis.spectrum.wrenches[:, -1], start.shaped.joints[:, -1]
    error, h = 0.02 * n, 1e-4
    pose = pose_of(law, q)

    def half_squared(way):
        moved = pose_of(law, q + way * w)
        turned = pin.log3(moved.rotation @ pose.rotation.T)
        left = n @ (error - np.r_[moved.translation - pose.translation, turned])
        return 0.5 * left**2

    # By central differences: h² of the fourth derivative, some 10.
    second = (half_squared(h) - 2.0 * half_squared(0.0) + half_squared(-h)) / h**2
    s = start.analysis.spectrum.s[-1]
    _, passed = law.led(start, error, NOTHING, NOTHING)
    damping = abs(second - s**2)
    lost = (COASTING * law.mechanism.scene.perception.s_on) ** 2
    rigid = start.analysis.weights[-1]
    assert rigid > 0.5
    assert passed[-1] == pytest.approx(rigid * damping / (s**2 + damping + lost), rel=1e-4)


def test_joints_are_never_led_faster_than_allowed():
    """|L⁻ᵀ y| ≤ 2 ω rates for each rigid direction, whatever is asked for."""
    rng = np.random.default_rng(4)
    for angle in np.r_[0.0, np.geomspace(1e-9, 0.3, 30)]:
        for size in (1e-6, 1.0, 1e6):
            state = UR5E.state(wrist(angle), NOTHING)
            error, asked = 1e-3 * rng.normal(size=6), size * rng.normal(size=(2, 6))
            given, _ = UR5E.led(state, error, *asked)
            joints = np.linalg.solve(state.factor.T, given)
            rigid = np.count_nonzero(state.analysis.weights)
            most = 2.0 * UR5E.gains.linear_rate * UR5E.gains.joint_rate * rigid
            assert np.linalg.norm(joints) <= most * (1.0 + 1e-9)


def followed(gains):
    """Return the largest error, m and rad, of a UR5e that is led through the singular pose."""
    law, h, error = law_of("ur5e", gains=gains), 1e-3, 0.0
    # rad/s: over 0.6 s the wrist goes from -0.15 to 0.15 rad.
    rate = np.array([0.1, 0.05, -0.05, -0.1, 0.5, 0.1])
    q, v = wrist(-0.15), rate.copy()
    for tick in range(600):
        there = law.state(wrist(-0.15) + h * tick * rate, rate).point
        target = Target(there.pose, there.twist, there.drift)
        torque = law.command(law.state(q, v), target).torque
        vdot, _ = accelerated(law, q, v, torque)
        q = q + h * v + 0.5 * h**2 * vdot
        v = v + h * vdot
        left = pin.log6(
            pose_of(law, q).actInv(law.state(wrist(-0.15) + h * (tick + 1) * rate, rate).point.pose)
        )
        error = max(error, float(np.abs(left.vector).max()))
    return error


def test_a_path_through_the_singular_pose_is_followed():
    """Joints that go straight through it: a motion that the robot can make, and makes."""
    free = {"linear_rate": 60.0, "angular_rate": 60.0, "rest_rate": 10.0}
    # Of first order in 1 ms: 0.5 ms of v̇, some 0.1 m/s² and rad/s², over ω = 60.
    assert followed(Gains(**free)) < 2e-5
    # Joints that are led by nothing stay behind.
    assert followed(Gains(**free, joint_rate=1e-3)) > 5e-4
