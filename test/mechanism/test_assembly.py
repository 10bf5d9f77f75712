# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The initial state: closed to 1e-12, on the nearest branch, or refused with the reason."""

import numpy as np
import pytest

from hapticmech_ros.errors import ClosureError
from oracles.analysed import terms_of
from oracles.differences import relative
from oracles.generator import blank, closed_chain
from oracles.kinematics import closure_residual, rotation_of_quaternion
from oracles.planar_linkages import (
    INERTIAS,
    LENGTHS,
    MASSES,
    chain,
    five_bar,
    five_bar_bent,
    pin_end,
)
from oracles.running import simulator, with_start


@pytest.mark.parametrize("kind", ["spherical", "revolute", "weld", "planar_pin"])
@pytest.mark.parametrize("seed", range(5))
def test_closes_to_a_picometre(kind, seed):
    sample = closed_chain(seed, kind)
    mechanism = terms_of(sample.document, sample.q).mechanism
    off = np.random.default_rng(seed).uniform(-0.1, 0.1, sample.v.size)
    document = with_start(sample.document, mechanism.integrate(sample.q, off), sample.v)
    state = simulator(document).initial_state()
    assert state.closure_error <= 1e-12  # the promise
    # The oracle sees the same, plus the rounding of ten rotations.
    assert np.abs(closure_residual(document, state.q)).max() < 1.01e-12
    # W v after one projection: eps times |W|, |L| and |L^-1|, below 1e4 together.
    rates = terms_of(document, state.q).w @ state.v
    assert np.linalg.norm(rates) < 1e-12 * np.linalg.norm(sample.v)


@pytest.mark.parametrize("side", [1, -1])
@pytest.mark.parametrize("bend", [0.6, -0.6, 0.25, -0.25])
def test_five_bar_stays_on_the_branch_it_was_authored_near(bend, side):
    q = five_bar_bent(1.9, bend, side)
    for seed in range(3):
        off = np.random.default_rng(seed).uniform(-0.08, 0.08, 4)
        state = simulator(with_start(five_bar(), q + off)).initial_state()
        assert np.sign(state.q[3]) == np.sign(bend)
        assert np.sign(np.sin(state.q[1])) == np.sign(np.sin(q[1]))
        # The closed position it was displaced from is in reach; the answer is no further than
        # twice it.
        assert np.abs(state.q - (q + off)).max() < 2.0 * np.linalg.norm(off)


def test_a_closed_pose_is_left_as_it_was_authored():
    q = five_bar_bent(1.9, 0.6)
    state = simulator(with_start(five_bar(), q)).initial_state()
    assert np.array_equal(state.q, q)


def test_rates_are_the_nearest_allowed_ones_in_the_mass_metric():
    q, v = five_bar_bent(1.9, 0.6), np.array([1.0, -2.0, 0.5, 3.0])
    state = simulator(with_start(five_bar(), q, v)).initial_state()
    terms = terms_of(five_bar(), q)
    weighted = np.linalg.solve(terms.d, terms.w.T)
    expected = v - weighted @ np.linalg.solve(terms.w @ weighted, terms.w @ v)
    assert relative(state.v, expected) < 1e-12  # eps times the condition of W D^-1 W^T, 1e2


def test_a_scene_out_of_reach_is_refused_by_name():
    reach, pivot = LENGTHS.sum(), 0.25
    document = pin_end(chain(LENGTHS, MASSES, INERTIAS), np.array([pivot, 0.0]))
    with pytest.raises(ClosureError, match="pin") as caught:
        simulator(with_start(document, np.array([0.3, 0.2, 0.1, -0.1]))).initial_state()
    assert caught.value.closures == ("pin",)
    # The gap is at least 55 mm, its largest component at least that over sqrt(2).
    assert (pivot - reach) / np.sqrt(2.0) < caught.value.residual < 2.0 * (pivot - reach)


def hinged(kind, angle):
    """Return a free body closed on the world, its frame turned by ``angle`` about x."""
    document = blank()
    inertia = {"ixx": 0.010, "iyy": 0.012, "izz": 0.014}
    joint = {"name": "joint", "type": "free"}
    inertial = {"mass": 1.0, "inertia": inertia}
    document["links"] = [{"name": "body", "parent": "world", "joint": joint, "inertial": inertial}]
    document["operational_points"] = [{"name": "grip", "link": "body"}]
    a = {"link": "body", "origin": {"xyz": [0.1, 0.0, 0.0]}}
    document["closures"] = [{"name": "hinge", "kind": kind, "a": a, "b": {"link": "world"}}]
    q = np.array([0.0, 0.0, 0.0, np.sin(angle / 2), 0.0, 0.0, np.cos(angle / 2)])
    return with_start(document, q)


@pytest.mark.parametrize("kind", ["weld", "revolute"])
@pytest.mark.parametrize("degrees", [-80, -30, 0, 30, 80])
def test_axes_less_than_90_degrees_apart_close(kind, degrees):
    state = simulator(hinged(kind, np.radians(degrees))).initial_state()
    up = rotation_of_quaternion(*state.q[3:])[2, 2]
    assert up == pytest.approx(1.0, abs=1e-12)  # cosine of the angle left: closed to 1e-12


@pytest.mark.parametrize("kind", ["weld", "revolute"])
@pytest.mark.parametrize("degrees", [100, 120, 170, 180])
def test_axes_more_than_90_degrees_apart_are_refused(kind, degrees):
    """At 180 degrees the axes' part of phi is zero: it must not pass for closed."""
    with pytest.raises(ClosureError, match="90 degrees") as caught:
        simulator(hinged(kind, np.radians(degrees))).initial_state()
    assert caught.value.closures == ("hinge",)
