# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A slider-crank felt at its crank pin and at its piston, against closed forms over the turn."""

import numpy as np
import pytest

from hapticmech_ros import analyse

NAME = "slider_crank_engine"

RADIUS, ROD = 0.04, 0.13
INMOST = ROD - RADIUS  # where the piston counts from
FLYWHEEL = 9.8e-4
ROD_MASS, ROD_CENTRE, ROD_MOMENT = 0.08, 0.05, 1.4e-4
PISTON_MASS = 0.8
PUSH = 0.03
DAMPING = {"crank": 0.004, "rod": 1e-4, "piston": 0.2}
ANGLES = np.linspace(0.1, 0.1 + 2.0 * np.pi, 25)


class Turn:
    """Closed forms at a crank's angle: rates are per rad/s of the crank."""

    def __init__(self, angle):
        sine, cosine = np.sin(angle), np.cos(angle)
        tilt_sine = -RADIUS / ROD * sine
        tilt_cosine = np.sqrt(1.0 - tilt_sine**2)
        self.tilt = np.arcsin(tilt_sine)
        self.tilt_rate = -RADIUS * cosine / (ROD * tilt_cosine)
        self.piston = RADIUS * cosine + ROD * tilt_cosine
        self.piston_rate = -RADIUS * sine - ROD * tilt_sine * self.tilt_rate
        self.pin_rate = RADIUS * np.array([-sine, cosine])
        centre_rate = self.pin_rate + ROD_CENTRE * self.tilt_rate * np.array(
            [-tilt_sine, tilt_cosine]
        )
        self.inertia = (
            FLYWHEEL
            + ROD_MASS * centre_rate @ centre_rate
            + ROD_MOMENT * self.tilt_rate**2
            + PISTON_MASS * self.piston_rate**2
        )
        self.damping = (
            DAMPING["crank"]
            + DAMPING["rod"] * (self.tilt_rate - 1.0) ** 2
            + DAMPING["piston"] * self.piston_rate**2
        )
        self.q = np.array([angle, self.tilt - angle, self.piston - INMOST])


@pytest.mark.parametrize("angle", ANGLES)
def test_the_mass_at_the_crank_pin_comes_and_goes(angle, mechanism):
    """X = j jᵀ / I(angle), with j the twist of the pin at 1 rad/s of the crank."""
    turn = Turn(angle)
    found = analyse(mechanism, turn.q, point="crank_pin")
    twist = np.concatenate((turn.pin_rate, np.zeros(3), (1.0,)))
    # Products of some ten terms, and closures of condition up to 1e2: 1e-12 of the largest entry.
    size = 1.0 / turn.inertia
    expected = np.outer(twist, twist) / turn.inertia
    assert found.inverse_inertia == pytest.approx(expected, rel=1e-10, abs=1e-12 * size)
    assert found.rank == 1
    assert found.constraint_wrenches.shape == (6, 2)


@pytest.mark.parametrize("angle", ANGLES)
def test_the_mass_at_the_piston(angle, mechanism):
    turn = Turn(angle)
    found = analyse(mechanism, turn.q, point="piston_crown")
    mass = turn.inertia / turn.piston_rate**2
    assert 1.0 / found.inverse_inertia[0, 0] == pytest.approx(mass, rel=1e-9)


@pytest.mark.parametrize("angle", [0.0, np.pi])
def test_at_a_dead_centre_the_piston_is_rigid_and_the_pin_is_not(angle, mechanism):
    """A push on the piston turns nothing: the third constraint of the plane."""
    turn = Turn(angle)
    piston = analyse(mechanism, turn.q, point="piston_crown")
    assert piston.rank == 0
    assert piston.constraint_wrenches.shape == (6, 3)
    # x_piston' is r sin, next to rounding here.
    assert piston.spectrum.s[0] < 1e-12
    assert analyse(mechanism, turn.q, point="crank_pin").rank == 1


def test_the_pin_is_two_constraints_over_whole_turns(run):
    turned = run.of(lambda s: s.mechanism.q[0])
    assert turned[-1] - turned[0] > 10.0 * np.pi
    assert run.changes == []
    assert run.count[0] == 2


def test_the_crank_obeys_its_own_equation_of_motion(run):
    """I ω' + ½ dI/dθ ω² = couple - c ω: one turn of the session against Runge and Kutta's rule.

    The session's couple is the hand's and what the position channel adds, as it was commanded.
    """
    begin, end = 3000, 4000
    states = run.of(lambda s: (s.mechanism.q[0], s.mechanism.v[0]))
    pushes = run.of(lambda s: s.output.mechanism)
    h = run.session.period

    def rates(state, push):
        angle, speed = state
        turn, step = Turn(angle), 1e-5
        slope = (Turn(angle + step).inertia - Turn(angle - step).inertia) / (2.0 * step)
        couple = push[5] + push[:2] @ turn.pin_rate
        force = couple - turn.damping * speed - 0.5 * slope * speed**2
        return np.array([speed, force / turn.inertia])

    state = states[begin]
    for tick in range(begin, end):
        push = pushes[tick - 1]  # commands act a period later
        one = rates(state, push)
        two = rates(state + 0.5 * h * one, push)
        three = rates(state + 0.5 * h * two, push)
        four = rates(state + h * three, push)
        state = state + h / 6.0 * (one + 2.0 * two + 2.0 * three + four)
    # The session's rule is of second order: (ω h)² of an angle of some 7 rad.
    assert states[end] == pytest.approx(state, rel=2e-5)


def test_the_speed_goes_with_the_mass_felt(run):
    """The heavier the slower: the flywheel's even part hides in neither."""
    settled = run.time > 3.0
    speeds = run.of(lambda s: s.mechanism.v[0])[settled]
    masses = run.of(lambda s: 1.0 / np.trace(s.analysis.inverse_inertia[:2, :2]))[settled]
    assert np.corrcoef(speeds, masses)[0, 1] < -0.5
    assert speeds.max() > 1.3 * speeds.min()


def test_the_hand_feels_the_couple_that_it_gives(run):
    """Device and crank go together, so what the device gives back is the hand's couple or so."""
    settled = run.time > 1.0
    torque = run.of(lambda s: s.output.device[5])[settled]
    assert torque.mean() == pytest.approx(-PUSH, rel=0.1)
    lag = run.of(lambda s: np.abs(s.output.error[:2]).max())[settled]
    assert lag.max() < 5e-4
