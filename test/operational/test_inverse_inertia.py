# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Laws of X on random mechanisms: symmetry, sign, rank, null space, order, redundancy; and a_0."""

from functools import cache

import numpy as np
import pytest

from oracles import closed_form
from oracles.analysed import sample_terms, terms_of
from oracles.differences import relative
from oracles.generator import random_mechanism
from sampling import sampled

SAMPLES = [(seed, planar) for planar in (False, True) for seed in sampled(range(10), planar)]
every_sample = pytest.mark.parametrize(("seed", "planar"), SAMPLES)
every_form = pytest.mark.parametrize("form", ["serial", "closed", "duplicated"])
both_points = pytest.mark.parametrize("point", ["tip", "middle"])


@cache
def built(seed, planar, form, point="tip"):
    sample = random_mechanism(seed, planar, form != "serial", form == "duplicated")
    return sample_terms(sample, point)


@every_sample
@every_form
@both_points
def test_symmetric_and_positive_semidefinite(seed, planar, form, point):
    x = built(seed, planar, form, point).x
    assert np.array_equal(x, x.T)
    values = np.linalg.eigvalsh(x)
    # X = S^T S: negative eigenvalues only by rounding of its entries, 6 eps of the largest.
    assert values[0] >= -1e-14 * max(values[-1], 0.0)


@every_sample
@every_form
@both_points
def test_agrees_with_the_null_space_formula(seed, planar, form, point):
    terms = built(seed, planar, form, point)
    expected = closed_form.inverse_inertia(terms.d, terms.w, terms.j)
    # Both lose about eps times cond(D) < 1e4 of the serial X, from which the closed one is cut.
    assert relative(terms.x, expected, scale=terms.scale) < 1e-11


@every_sample
@every_form
@both_points
def test_rank_and_null_space(seed, planar, form, point):
    terms = built(seed, planar, form, point)
    together = closed_form.rank(np.vstack((terms.w, terms.j)))
    assert terms.analysis.rank == together - closed_form.rank(terms.w)
    # F is in ker X where the closures can carry J^T F: it adds nothing to the rows of W.
    wrenches = terms.analysis.constraint_wrenches[terms.analysis.rows]
    assert wrenches.shape[1] == terms.j.shape[0] - terms.analysis.rank
    for wrench in wrenches.T:
        force = terms.j.T @ wrench
        rest = closed_form.null_space(terms.w, force.size).T @ force
        # |J^T F| up to |J| |F|; N comes from an SVD that is exact to eps.
        assert np.linalg.norm(rest) < 1e-12 * np.linalg.norm(terms.j) * np.linalg.norm(wrench)
        # ...and X F = 0, in the scale of the X that the closures cut down.
        moved = np.linalg.norm(terms.x @ wrench)
        assert moved < 1e-12 * terms.scale * np.linalg.norm(wrench)


@every_sample
@every_form
@both_points
def test_mu_is_between_zero_and_one(seed, planar, form, point):
    mu = built(seed, planar, form, point).analysis.spectrum.mu
    assert mu.min() >= 0.0
    assert mu.max() <= 1.0 + 1e-13  # 1 is reached by free links, to eps times cond(D)
    assert np.all(np.diff(mu) <= 0.0)


def test_a_free_body_alone_has_mu_of_one():
    sample = random_mechanism(0, links=1, closed=False)
    document = sample.document | {"operational_points": sample.document["operational_points"][:1]}
    link = document["links"][0]
    joint = link["joint"] | {"type": "free"}
    document = document | {"links": [link | {"joint": joint}]}
    terms = terms_of(document, np.array([0.3, 0.1, -0.2, 0.5, 0.5, -0.5, 0.5]))
    assert np.abs(terms.analysis.spectrum.mu - 1.0).max() < 1e-13  # eps times cond(I_l) < 1e3
