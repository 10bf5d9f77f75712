# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Closure forces against a dense KKT solve, and accelerations against Pinocchio's own solver."""

import numpy as np
import pytest

from oracles import closed_form
from oracles.analysed import terms_of
from oracles.differences import relative
from oracles.generator import closed_chain, random_mechanism
from oracles.pinocchio_loops import constraint_dynamics
from sampling import sampled

CASES = [(seed, planar) for planar in (False, True) for seed in sampled(range(10), planar)]


def moving(sample):
    """Return the sample's terms at rates that its closures allow, and a joint force."""
    at_rest = terms_of(sample.document, sample.q)
    basis = closed_form.null_space(at_rest.w, sample.v.size)
    v = basis @ (basis.T @ sample.v)
    return terms_of(sample.document, sample.q, v), v, np.cos(np.arange(v.size))


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("kind", ["spherical", "revolute", "weld", "planar_pin"])
def test_independent_closures_have_one_closure_force(kind, seed):
    sample = closed_chain(seed, kind)
    terms, v, force = moving(sample)
    assert terms.evaluation.space.rank == terms.w.shape[0]
    found, forces = terms.evaluation.acceleration(force)
    net = force + terms.evaluation.passive_force - terms.evaluation.bias_force
    _, expected = closed_form.kkt(terms.d, terms.w, net, terms.evaluation.closure_bias)
    # KKT matrices here have condition numbers up to 1e6: 1e6 * 1e-16 and a margin of ten.
    assert relative(forces, expected) < 1e-9
    force = force + terms.evaluation.passive_force
    rates, theirs = constraint_dynamics(terms.mechanism, sample.document, sample.q, v, force)
    assert relative(found, rates) < 1e-7  # Pinocchio's proximal iterations, as below
    if kind in ("spherical", "weld"):
        # lambda acts on frame a with the opposite sign: D v' + h = tau - W^T lambda.
        assert relative(-forces, np.concatenate(theirs)) < 1e-7


@pytest.mark.parametrize(("seed", "planar"), CASES)
def test_agrees_with_pinocchios_constraint_solver(seed, planar):
    sample = random_mechanism(seed, planar)
    terms, v, force = moving(sample)
    found, _ = terms.evaluation.acceleration(force)
    force = force + terms.evaluation.passive_force
    expected, _ = constraint_dynamics(terms.mechanism, sample.document, sample.q, v, force)
    # Proximal iterations stop at 1e-9 regularisation where rows are redundant.
    assert relative(found, expected) < 1e-7


def test_redundant_closures_share_the_smallest_force():
    once, twice = random_mechanism(3, True), random_mechanism(3, True, duplicated=True)
    single, _, force = moving(once)
    double, _, _ = moving(twice)
    _, one = single.evaluation.acceleration(force)
    _, both = double.evaluation.acceleration(force)
    half = one.size
    # Two equal springs in parallel: half each, the frames of the second exchanged.
    assert relative(both[:half], one / 2.0) < 1e-10
    assert relative(-both[half:], one / 2.0) < 1e-10
