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


def test_the_hand_feels_the_couple_that_it_gives(run):
    """Device and crank go together, so what the device gives back is the hand's couple or so."""
    settled = run.time > 1.0
    torque = run.of(lambda s: s.output.device[5])[settled]
    assert torque.mean() == pytest.approx(-PUSH, rel=0.1)
    lag = run.of(lambda s: np.abs(s.output.error[:2]).max())[settled]
    assert lag.max() < 5e-4
