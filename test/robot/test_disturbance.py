# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The observer of disturbances: it follows what the model does not know, and nothing else."""

import numpy as np
import pytest

from hapticmech_ros.errors import InvalidInputError
from hapticmech_ros.robot.follower import DisturbanceObserver, balanced
from hapticmech_ros.robot.law import Target
from oracles.driven_robots import accelerated, law_of, pose_of, robot

RATE = 20.0
Q = np.array([0.3, 0.7, 0.2, -1.1, 0.4, 0.9, 0.1])
V = np.linspace(-0.6, 0.4, 7)
CONTACT = np.array([4.0, -3.0, 8.0, 0.3, -0.2, 0.1])


def estimates(period, disturbance, time):
    """Return the estimate after a while of a motion under gravity compensation and a push."""
    law = law_of("iiwa14")
    observer = DisturbanceObserver(law.mechanism, RATE, period)
    state = law.state(Q, V)
    found = observer.begin(state)
    for _ in range(round(time / period)):
        torque = state.bias_force
        # The midpoint rule, by Pinocchio: of second order, where the observer is of first.
        vdot, _ = accelerated(law, state.q, state.v, torque + disturbance, CONTACT)
        middle = state.q + 0.5 * period * state.v, state.v + 0.5 * period * vdot
        vdot, _ = accelerated(law, *middle, torque + disturbance, CONTACT)
        now = law.state(state.q + period * middle[1], state.v + period * vdot)
        found = observer.next(found, state, torque, CONTACT, now)
        state = now
    return found.disturbance


def test_it_follows_a_constant_disturbance_at_its_rate():
    """r = d (1 - exp(-κ t)), to first order in the period."""
    disturbance, time = np.array([3.0, -2.0, 1.0, 2.5, -0.5, 0.4, 0.1]), 0.1
    exact = disturbance * (1.0 - np.exp(-RATE * time))
    coarse, fine = (
        np.abs(estimates(period, disturbance, time) - exact).max() for period in (1e-3, 5e-4)
    )
    assert coarse / fine == pytest.approx(2.0, rel=0.1)
    # Half a period of what changes at 20 1/s, 3 N m and momenta of the motion.
    assert fine < 0.05


def test_a_balanced_disturbance_does_not_accelerate_the_point():
    law, disturbance = law_of("iiwa14"), np.linspace(-3.0, 3.0, 7)
    state = law.state(Q, V)
    observer = DisturbanceObserver(law.mechanism, RATE, 1e-3)
    known = observer.begin(state)._replace(disturbance=disturbance)
    command = law.command(balanced(state, known), Target(pose_of(law, Q)))
    _, reached = accelerated(law, Q, V, command.torque + disturbance)
    # As without a disturbance, in test_law.
    np.testing.assert_allclose(reached, command.asked, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("rate", [-1.0, 1000.0, np.nan])
def test_a_rate_that_the_period_does_not_allow_is_refused(rate):
    with pytest.raises(InvalidInputError, match="rate"):
        DisturbanceObserver(robot("iiwa14"), rate, 1e-3)


def test_an_observer_without_a_rate_keeps_what_it_began_with():
    law, held = law_of("iiwa14"), np.linspace(-3.0, 3.0, 7)
    observer, state = DisturbanceObserver(law.mechanism, 0.0, 1e-3), law.state(Q, V)
    found = observer.next(observer.begin(state, held), state, 5.0 * held, CONTACT, state)
    np.testing.assert_array_equal(found.disturbance, held)
