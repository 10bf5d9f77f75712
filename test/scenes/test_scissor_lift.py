# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A scissor lift: one freedom behind five loops, its height, its mass, the lever of its bars."""

import numpy as np
import pytest

from hapticmech_ros import Simulator, analyse, load_scene
from hapticmech_ros.mechanism.redundancy import redundancy

NAME = "scissor_lift"

STAGES, BAR = 3, 0.12
PLATFORM, ROLLER, BAR_MASS, BAR_MOMENT = 0.8, 0.03, 0.05, 6e-5
GRAVITY = 9.81
ANGLES = np.linspace(0.2, 1.2, 7)


def height_of(angle):
    return STAGES * BAR * np.sin(angle)


def lever_of(angle):
    """Return how much the platform rises while the foot slides in by 1."""
    return STAGES / np.tan(angle)


def mass_of(angle):
    """Return the mass of everything, referred to the platform's way up, kg."""
    up = (2.0 * np.arange(1, STAGES + 1) - 1.0) / (2.0 * STAGES)  # of the bars' middles
    aside = np.tan(angle) / (2.0 * STAGES)  # half the foot's way
    turn = 1.0 / (STAGES * BAR * np.cos(angle))
    bars = 2.0 * (BAR_MASS * (up**2 + aside**2) + BAR_MOMENT * turn**2)
    return PLATFORM + ROLLER + bars.sum() + 2.0 * ROLLER / lever_of(angle) ** 2


def configuration(angle):
    """Return q: bars in pairs, then foot, platform and roller, in the scene's order."""
    across = np.pi - 2.0 * angle
    bars = [angle, across, -across, across, -across, across]
    return np.array([*bars, BAR * np.cos(angle), height_of(angle), BAR * np.cos(angle)])


@pytest.mark.parametrize("angle", ANGLES)
def test_it_closes_at_its_height_and_has_one_freedom(angle, mechanism):
    q, closed = configuration(angle), mechanism.initially_active
    assert mechanism.closing_terms(q, closed).error < 1e-15
    found = redundancy(mechanism, q, closed)
    assert (found.rank, found.mobility) == (8, 1)
    # Loops through the bars are needed, the guide is not.
    assert found.wholly_redundant == ("guide_pin",)


@pytest.mark.parametrize("angle", ANGLES)
def test_the_platform_feels_all_that_moves_and_moves_up_and_down_only(angle, mechanism):
    found = analyse(mechanism, configuration(angle), point="platform_rim")
    expected = np.zeros((6, 6))
    expected[1, 1] = 1.0 / mass_of(angle)
    # Rank 8 of 10 rows of condition up to 1e2, and D's up to 1e3.
    assert found.inverse_inertia == pytest.approx(expected, abs=1e-9 * expected[1, 1])
    assert found.constraint_wrenches.shape == (6, 2)
    assert found.constraint_wrenches[1] == pytest.approx(np.zeros(2), abs=1e-9)


@pytest.mark.parametrize("angle", ANGLES)
def test_the_foot_feels_it_over_the_lever(angle, mechanism):
    found = analyse(mechanism, configuration(angle), point="foot_grip")
    mass = mass_of(angle) * lever_of(angle) ** 2
    assert 1.0 / found.inverse_inertia[0, 0] == pytest.approx(mass, rel=1e-9)


def test_the_lift_weighs_nothing(mechanism):
    """A constant force carries it everywhere: let go of at any height, it stays."""
    scene = load_scene("scissor_lift")
    simulator = Simulator(scene)
    lifted = PLATFORM + ROLLER + STAGES * BAR_MASS
    # The file's force has six digits.
    assert scene.links[7].joint.effort == pytest.approx(lifted * GRAVITY, rel=1e-6)
    closed = mechanism.initially_active
    for angle in ANGLES:
        q = configuration(angle)
        terms = simulator.mechanism.evaluate(q, np.zeros(9), closed)
        rates, _ = terms.acceleration(np.zeros(9))
        assert np.abs(rates).max() < 1e-4 * GRAVITY
    start = simulator.initial_state()
    end = simulator.run(start, 1000).end
    assert np.abs(end.q - start.q).max() < 1e-6
