# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Through singular poses: torques are bounded and as smooth as the pose, and no energy is made."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pinocchio as pin
import pytest
from scipy.integrate import solve_ivp

from hapticmech_ros.robot.law import Gains, Target, shaped_inertia
from oracles.driven_robots import accelerated, law_of, pose_of
from sampling import sampled

# Poses whose s is singular where one joint is at 0: the elbow, and the wrist.
SINGULAR = {
    "iiwa14": (np.array([0.3, 0.7, 0.2, 0.0, 0.4, 0.9, 0.1]), 3),
    "ur5e": (np.array([0.1, -1.2, 1.3, -0.9, 0.0, 0.2]), 4),
}
NAMES = sorted(SINGULAR)


def bent(name, angle):
    pose, joint = SINGULAR[name]
    q = pose.copy()
    q[joint] = angle
    return q


def pulled(law, q):
    """Return the state, and a command that asks for 1 m/s² and 1 rad/s² along every axis."""
    state = law.state(q, np.zeros_like(q))
    return state, law.command(state, Target(pose_of(law, q), acceleration=np.ones(6)))


@pytest.mark.parametrize("name", NAMES)
def test_torques_are_bounded_by_the_metric_whatever_the_pose(name):
    """|L⁻¹ τ| ≤ 2 |nᵀ ẍ_c| / s_on; the exact inverse has no bound."""
    law = law_of(name, gains=Gains(posture_rate=0.0))
    # R1, and R7, which its saturation keeps below that for these accelerations.
    bound = 2.0 / law.mechanism.scene.perception.s_on
    exact = []
    for angle in np.r_[0.0, np.geomspace(1e-8, 0.5, 60), -np.geomspace(1e-8, 0.5, 60)]:
        state, command = pulled(law, bent(name, angle))
        asked = state.analysis.spectrum.wrenches.T @ command.asked
        motion = np.linalg.solve(state.factor, command.torque - state.bias_force)
        assert np.linalg.norm(motion) <= bound * np.linalg.norm(asked)
        if angle:
            inverse = np.linalg.pinv(state.analysis.inverse_inertia, rcond=1e-15)
            exact.append(np.abs(state.point.jacobian.T @ inverse @ command.asked).max())
    assert max(exact) > 1e5


@pytest.mark.parametrize(
    ("name", "start", "end"),
    [(name, *way) for name in NAMES for way in sampled([(-0.01, 0.01), (0.01, 0.4)], name)],
)
def test_torques_are_continuous_through_the_singular_pose(name, start, end):
    """Halving the steps halves the largest change: what jumps would keep it.

    Where s is below λ, 2 mrad of the iiwa's elbow, torques turn round.
    """
    law = law_of(name, gains=Gains(posture_rate=0.0))

    def largest(count):
        torques = [
            pulled(law, bent(name, angle))[1].torque for angle in np.linspace(start, end, count)
        ]
        return max(np.abs(b - a).max() for a, b in pairwise(torques))

    # To first order in a thousandth of the way, over which what changes fastest does by a fiftieth.
    assert largest(2001) / largest(4001) == pytest.approx(2.0, rel=0.05)


def test_a_weight_that_rounding_puts_above_one_is_rigid():
    law = law_of("iiwa14")
    state = law.state(bent("iiwa14", 0.0), np.zeros(7))
    above = replace(state.analysis, weights=np.nextafter(state.analysis.weights, 2.0))
    found = shaped_inertia(above, state.point.jacobian, state.factor)
    assert np.isfinite(found.units).all()
    assert np.isfinite(found.inverse).all()
    assert found.free.min() == 0.0


@pytest.mark.parametrize("name", NAMES)
def test_the_other_directions_are_decoupled_in_the_singular_pose_itself(name):
    law = law_of(name)
    state, command = pulled(law, bent(name, 0.0))
    _, reached = accelerated(law, state.q, state.v, command.torque)
    controlled = state.analysis.weights == 0.0
    assert 1 <= np.count_nonzero(~controlled) <= 2
    along = state.analysis.spectrum.wrenches[:, controlled].T
    # Masses of up to 1 / s² = 1e4 of the link's, in numbers of 2e-16 each.
    np.testing.assert_allclose(along @ reached, along @ command.asked, rtol=1e-9, atol=1e-9)


def moved(law, q, target, times):
    """Return the states q, v at times, from rest at q, under the law throughout."""

    def rate(_, state):
        q, v = np.split(state, 2)
        torque = law.command(law.state(q, v), target).torque
        return np.r_[v, accelerated(law, q, v, torque)[0]]

    start = np.r_[q, 0.0 * q]
    found = solve_ivp(rate, times[[0, -1]], start, "DOP853", times, rtol=1e-10, atol=1e-12)
    return [np.split(state, 2) for state in found.y.T]


def test_a_straight_arm_bends_again_when_it_is_called_back():
    """In the singular pose no torque pulls inwards: the posture bends the elbow, then the law."""
    law = law_of("iiwa14")
    straight = np.array([0.0, 0.8, 0.0, 0.0, 0.0, 0.5, 0.0])
    target = Target(pose_of(law, np.array([0.0, 0.8, 0.0, -1.2, 0.0, 0.8, 0.0])))
    *_, (q, _) = moved(law, straight, target, np.array([0.0, 3.0]))
    error = target.pose.actInv(pose_of(law, q))
    # Critically damped at 30 1/s it is at rest to exp(-30) after 1 s.
    assert np.linalg.norm(pin.log6(error).vector) < 1e-6
    assert q[3] < -0.5
