# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The operational-space law: decoupling, null space, force, and what rests stays at rest."""

import numpy as np
import pinocchio as pin
import pytest

from hapticmech_ros.errors import InvalidInputError
from hapticmech_ros.mechanism import Mechanism
from hapticmech_ros.robot.law import ForceTask, Gains, OperationalLaw, Target
from hapticmech_ros.scene import scene_from_document
from oracles.driven_robots import ROBOTS, accelerated, law_of, pose_of, poses
from oracles.planar_linkages import five_bar

NAMES = sorted(ROBOTS)
# v̇ is found from torques of 1e3 N m over effective masses of up to 1 / s² = 400 of the link's, in
# numbers of 2e-16 each.
EXACT = 1e-9


def target_near(law, q, seed):
    """Return a target some centimetres and degrees away, in motion."""
    rng = np.random.default_rng(seed)
    away = pin.exp6(pin.Motion(0.1 * rng.normal(size=6)))
    return Target(pose_of(law, q) * away, rng.normal(size=6), rng.normal(size=6))


@pytest.mark.parametrize("name", NAMES)
def test_the_point_accelerates_as_asked_away_from_singular_poses(name):
    law = law_of(name)
    s_off = law.mechanism.scene.perception.s_off
    for seed, (q, v) in enumerate(poses(name, 20, least=s_off)):
        command = law.command(law.state(q, v), target_near(law, q, seed))
        vdot, reached = accelerated(law, q, v, command.torque)
        np.testing.assert_allclose(reached, command.asked, rtol=EXACT, atol=EXACT)
        np.testing.assert_allclose(command.acceleration, vdot, rtol=EXACT, atol=EXACT)


def test_the_asked_acceleration_is_that_of_a_damped_oscillator():
    gains = Gains(linear_rate=7.0, angular_rate=11.0, damping_ratio=0.6)
    law = law_of("iiwa14", gains=gains)
    ((q, v),) = poses("iiwa14", 1)
    state = law.state(q, v)
    away, pose, twist = np.array([0.01, -0.02, 0.03]), pose_of(law, q), state.point.twist
    command = law.command(state, Target(pin.SE3(pose.rotation, pose.translation + away)))
    expected = np.r_[49.0 * away - 8.4 * twist[:3], -13.2 * twist[3:]]
    # Of numbers of the order of 10; the logarithm of no rotation is 0 to 1e-16.
    np.testing.assert_allclose(command.asked, expected, atol=1e-11)


def in_null_space(state, torque):
    """Return Nᵀ τ with k_i = w_i, for torques (nv,)."""
    motion = np.linalg.solve(state.factor, torque)
    return state.factor @ state.shaped.null(motion, 1.0 - state.shaped.free)


@pytest.mark.parametrize("name", NAMES)
def test_torques_of_the_null_space_do_not_accelerate_the_point(name):
    """n_iᵀ J D⁻¹ Nᵀ τ = 0 along directions that the law controls, in singular poses too.

    With the most that R2 allows: k_i = w_i.
    """
    law, rng = law_of(name), np.random.default_rng(1)
    bent = [q for q, _ in poses(name, 10)]
    straight = [np.where(np.arange(law.mechanism.nv) == 3, 0.0, q) for q in bent]
    wrist = [np.where(np.arange(law.mechanism.nv) == 4, 0.0, q) for q in bent]
    seen = set()
    for q in bent + straight + wrist:
        state = law.state(q, np.zeros_like(q))
        controlled = state.analysis.weights == 0.0
        seen.add(int(controlled.sum()))
        torque = rng.normal(size=q.size)
        _, still = accelerated(law, q, state.v, state.bias_force)
        _, moved = accelerated(law, q, state.v, state.bias_force + in_null_space(state, torque))
        along = state.analysis.spectrum.wrenches[:, controlled].T
        scale = np.linalg.norm(along, axis=1)
        assert np.abs(along @ (moved - still) / scale).max() < EXACT * np.linalg.norm(torque)
    assert {5, 6} <= seen


@pytest.mark.parametrize("name", NAMES)
def test_a_wrench_that_is_balanced_by_joints_has_no_null_space_torque_beside_it(name):
    """Nᵀ Jᵀ n_i = w_i Jᵀ n_i: what the task controls and what is left over share no torque."""
    law = law_of(name)
    for q, v in poses(name, 10, seed=3):
        state = law.state(q, v)
        torques = state.point.jacobian.T @ state.analysis.spectrum.wrenches
        passed = np.array([in_null_space(state, torque) for torque in torques.T]).T
        expected = torques * (1.0 - state.shaped.free)
        # u_iᵀ u_j = δ_ij to 1e-16 / s, with s above 0.01 where anything is divided by it.
        assert np.abs(passed - expected).max() < 1e-11 * np.abs(torques).max()


def on_a_wall(law, q, v, seed, force):
    """Return a state without motion along a wall's normal n (3,), a target with a force, and n."""
    n = np.random.default_rng(seed).normal(size=3)
    n /= np.linalg.norm(n)
    row = n @ law.state(q, v).point.jacobian[:3]
    along = v - row * (row @ v) / (row @ row)
    near = target_near(law, q, seed)
    target = Target(near.pose, near.twist, near.acceleration, ForceTask(n, force))
    return law.state(q, along), target, n


@pytest.mark.parametrize("name", NAMES)
def test_a_controlled_force_stands_against_a_wall_whatever_moves_along_it(name):
    """With no acceleration along n the wall answers -n f_d exactly, by the dynamics alone."""
    law = law_of(name)
    s_off = law.mechanism.scene.perception.s_off
    for seed, (q, v) in enumerate(poses(name, 10, seed=5, least=s_off)):
        state, target, n = on_a_wall(law, q, v, seed, 13.0)
        command, unit = law.command(state, target, integral=2.0), np.r_[n, np.zeros(3)]
        _, free = accelerated(law, q, state.v, command.torque)
        _, pushed = accelerated(law, q, state.v, command.torque, unit)
        # The wall's force, -n times this, that leaves no acceleration along n.
        wall = -(unit @ free) / (unit @ (pushed - free))
        assert wall == pytest.approx(-15.0, rel=1e-8)
        # The motion along the wall is as asked nevertheless.
        _, reached = accelerated(law, q, state.v, command.torque, wall * unit)
        np.testing.assert_allclose(reached, command.asked, rtol=1e-8, atol=1e-8)


@pytest.mark.parametrize("name", NAMES)
def test_friction_disturbs_neither_a_controlled_force_nor_the_motion_along_the_wall(name):
    law = law_of(name)
    for seed, (q, v) in enumerate(poses(name, 5, seed=6, least=0.05)):
        state, target, n = on_a_wall(law, q, v, seed, 20.0)
        # A wall with friction, which presses with the force that is asked for.
        size = np.repeat((8.0, 4.0 * law.lever), 3)
        contact = target.force.without(np.random.default_rng(seed + 50).normal(size=6) * size)
        contact[:3] -= 20.0 * n
        command = law.command(state, target, contact)
        _, reached = accelerated(law, q, state.v, command.torque, contact)
        np.testing.assert_allclose(reached, command.asked, rtol=1e-8, atol=1e-8)
        # The motion does not leave the wall.
        assert n @ reached[:3] == pytest.approx(0.0, abs=1e-8)


def test_what_holds_a_tool_fast_is_balanced_up_to_the_controlled_force():
    law = law_of("iiwa14")
    force = ForceTask(np.array([0.0, 0.0, 1.0]), 5.0)
    weights = np.repeat((1.0, 1.0 / law.lever), 3)
    for size in (1.0, 4.9, 5.1, 1e3):
        beside = np.array([0.6, 0.0, 0.0, 0.0, 0.8 * law.lever, 0.0]) * size
        pushed = law.pushing(force, beside - 7.0 * np.eye(6)[2], integral=2.0)
        assert pushed[2] == 7.0
        pushed[2] = 0.0
        np.testing.assert_allclose(pushed, -min(1.0, 5.0 / size) * beside, rtol=1e-12)
        assert np.linalg.norm(weights * pushed) <= 5.0 * (1.0 + 1e-12)
    half = law.with_gains(Gains(contact_share=0.5))
    np.testing.assert_allclose(half.pushing(force, np.eye(6)[0], 0.0)[0], -0.5)


@pytest.mark.parametrize("name", NAMES)
def test_braking_takes_energy_from_every_motion(name):
    law = law_of(name)
    for q, v in poses(name, 10, seed=7):
        state = law.state(q, v)
        vdot, _ = accelerated(law, q, v, law.braking(state))
        # v̇ = -r v: with h compensated all joints decay alike.
        np.testing.assert_allclose(vdot, -law.gains.rest_rate * v, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("name", NAMES)
def test_damping_in_the_null_space_never_gives_energy(name):
    law = law_of(name, gains=Gains(posture_rate=0.0))
    for q, v in poses(name, 20, seed=8):
        state = law.state(q, v)
        damping = -state.factor @ (state.factor.T @ v)
        # vᵀ Nᵀ D v = |P^½ Lᵀ v|²; rounding of terms of that size.
        given = v @ in_null_space(state, damping)
        assert given <= 1e-12 * (v @ state.factor @ state.factor.T @ v)


def free_body():
    inertial = {"mass": 1.0, "inertia": {"ixx": 1.0, "iyy": 1.0, "izz": 1.0}}
    link = {"name": "body", "joint": {"name": "j", "type": "free"}, "inertial": inertial}
    return {
        "format": "hapticmech-scene/1",
        "name": "free",
        "task_space": "spatial",
        "links": [link],
        "operational_points": [{"name": "p", "link": "body"}],
        "hand": {"kind": "constant_wrench"},
    }


@pytest.mark.parametrize(
    ("make", "rule"),
    [
        (lambda: OperationalLaw(Mechanism(scene_from_document(five_bar()))), "no closures"),
        (lambda: OperationalLaw(Mechanism(scene_from_document(free_body()))), "revolute"),
        (lambda: law_of("iiwa14", torque_limits=np.array([1.0, 2.0])), "7 positive numbers"),
        (lambda: law_of("iiwa14", posture=np.zeros(3)), "q"),
        (lambda: law_of("iiwa14", point="nose"), "point"),
        (lambda: ForceTask(np.array([0.0, 0.0, 2.0]), 1.0), "unit vector"),
        (lambda: ForceTask(np.array([0.0, 0.0, 1.0]), np.nan), "finite"),
    ],
)
def test_robots_and_forces_that_the_law_cannot_use_are_refused(make, rule):
    with pytest.raises(InvalidInputError, match=rule):
        make()


@pytest.mark.parametrize(
    ("name", "value"),
    [
        *(("linear_rate", value) for value in (-1.0, np.nan, np.inf, 1e5)),
        ("contact_share", 1.5),
        ("joint_rate", 0.0),
    ],
)
def test_gains_that_are_none_are_refused(name, value):
    with pytest.raises(InvalidInputError, match=name):
        Gains(**{name: value})


def test_the_integral_of_a_force_is_bounded_and_ends_with_it():
    law = law_of("iiwa14", gains=Gains(force_rate=5.0))
    force, integral = ForceTask(np.array([0.0, 0.0, 1.0]), 10.0), 0.0
    for _ in range(10_000):
        integral = law.next_integral(integral, force, np.zeros(6), 0.001)
    assert integral == 10.0
    met = np.array([0.0, 0.0, -10.0, 0.0, 0.0, 0.0])
    assert law.next_integral(1.0, force, met, 0.001) == 1.0
    assert law.next_integral(1.0, None, met, 0.001) == 0.0
