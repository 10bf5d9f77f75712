# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Bricard's linkage: mobile where the count of freedoms says that it is not; one way to go."""

import numpy as np
import pytest

from hapticmech_ros import analyse, load_scene
from hapticmech_ros.mechanism.redundancy import redundancy
from hapticmech_ros.scene import document_of
from oracles.jacobians import Jacobians

NAME = "bricard"

RODS = 5
ANGLES = np.linspace(-0.5, 1.5, 9)


def way(angle):
    """Return hinges' positions and their rates per rad/s of the first, (5,) each.

    Every other hinge turns alike, by a and b, and the ring closes where (1 + sin a)(1 + sin b) = 1.
    """
    sine = np.sin(angle)
    other = np.arcsin(-sine / (1.0 + sine))
    rate = -np.cos(angle) / ((1.0 + sine) ** 2 * np.cos(other))
    return np.array([angle, other] * 3)[:RODS], np.array([1.0, rate] * 3)[:RODS]


def twist_and_inertia(angle):
    """Return the corner's twist (6,) and the inertia of all rods, per rad/s of the first hinge."""
    (q, rates), document = way(angle), document_of(load_scene("bricard"))
    oracle = Jacobians(document, q)
    corner = oracle.of_frame(document["operational_points"][0])
    return corner @ rates, rates @ oracle.inertia() @ rates


@pytest.mark.parametrize("angle", ANGLES)
def test_it_moves_though_it_should_not(angle, mechanism):
    """Counted: 6 (links - 1) - 5 hinges = 6 · 5 - 5 · 6 = 0. Found: five rows of rank four."""
    q, rates = way(angle)
    closed = mechanism.initially_active
    terms = mechanism.closing_terms(q, closed)
    assert terms.error < 1e-14
    assert np.abs(terms.jacobian @ rates).max() < 1e-13
    found = redundancy(mechanism, q, closed)
    assert (mechanism.nv, found.rank, found.mobility) == (5, 4, 1)
    counted = 6 * RODS - 5 * (RODS + 1)
    assert counted == 0


@pytest.mark.parametrize("angle", ANGLES)
def test_one_direction_is_free_and_five_are_held(angle, mechanism):
    """X is the corner's twist times its transpose, over the inertia of all rods."""
    twist, inertia = twist_and_inertia(angle)
    found = analyse(mechanism, way(angle)[0])
    expected = np.outer(twist, twist) / inertia
    # Moments stand in the file with seven digits.
    assert found.inverse_inertia == pytest.approx(expected, abs=1e-6 * expected.max())
    assert found.rank == 1
    wrenches = found.constraint_wrenches
    assert wrenches.shape == (6, 5)
    size = np.linalg.norm(twist) * np.linalg.norm(wrenches, axis=0)
    assert np.abs(twist @ wrenches).max() < 1e-9 * size.max()


def test_the_mass_felt_is_what_the_scene_promises():
    masses = []
    for angle in np.linspace(-0.52, 1.5, 41):
        twist, inertia = twist_and_inertia(angle)
        masses.append(inertia / (twist[:3] @ twist[:3]))
    assert min(masses) == pytest.approx(0.49, abs=0.01)
    assert max(masses) == pytest.approx(1.94, abs=0.02)
    twist, inertia = twist_and_inertia(0.0)
    assert inertia / (twist[:3] @ twist[:3]) == pytest.approx(0.664, abs=0.001)
