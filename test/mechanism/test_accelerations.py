# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Accelerations and closure forces against a dense KKT solve."""

import numpy as np
import pytest

from oracles import closed_form
from oracles.analysed import terms_of
from oracles.differences import relative
from oracles.generator import closed_chain, random_mechanism
from sampling import sampled

CASES = [(seed, planar) for planar in (False, True) for seed in sampled(range(10), planar)]


def moving(sample):
    """Return the sample's terms at rates that its closures allow, and a joint force."""
    at_rest = terms_of(sample.document, sample.q)
    basis = closed_form.null_space(at_rest.w, sample.v.size)
    v = basis @ (basis.T @ sample.v)
    return terms_of(sample.document, sample.q, v), np.cos(np.arange(v.size))


def by_kkt(terms, force):
    """Return accelerations and closure forces of a joint force."""
    net = force + terms.evaluation.passive_force - terms.evaluation.bias_force
    return closed_form.kkt(terms.d, terms.w, net, terms.evaluation.closure_bias)


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("kind", ["spherical", "revolute", "weld", "planar_pin"])
def test_independent_closures_have_one_closure_force(kind, seed):
    sample = closed_chain(seed, kind)
    terms, force = moving(sample)
    assert terms.evaluation.space.rank == terms.w.shape[0]
    found, forces = terms.evaluation.acceleration(force)
    rates, expected = by_kkt(terms, force)
    # KKT matrices here have condition numbers up to 1e6: 1e6 * 1e-16 and a margin of ten.
    assert relative(forces, expected) < 1e-9
    assert relative(found, rates) < 1e-9


@pytest.mark.parametrize(("seed", "planar"), CASES)
def test_any_closures_allow_one_acceleration(seed, planar):
    terms, force = moving(random_mechanism(seed, planar))
    found, _ = terms.evaluation.acceleration(force)
    assert relative(found, by_kkt(terms, force)[0]) < 1e-9


def test_redundant_closures_share_the_smallest_force():
    once, twice = random_mechanism(3, True), random_mechanism(3, True, duplicated=True)
    single, force = moving(once)
    double, _ = moving(twice)
    _, one = single.evaluation.acceleration(force)
    _, both = double.evaluation.acceleration(force)
    half = one.size
    # Two equal springs in parallel: half each, the frames of the second exchanged.
    assert relative(both[:half], one / 2.0) < 1e-10
    assert relative(-both[half:], one / 2.0) < 1e-10
