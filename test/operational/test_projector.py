# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The smooth choice of constrained directions: weights, P_c and the balanced share."""

from itertools import pairwise

import numpy as np
import pytest
import scipy.linalg

from hapticmech_ros.mechanism import Mechanism
from hapticmech_ros.operational import analyse
from hapticmech_ros.operational.results import Spectrum
from hapticmech_ros.scene import scene_from_document
from oracles.analysed import sample_terms
from oracles.differences import relative
from oracles.generator import random_mechanism
from oracles.operational.projector import constraint_projector, rigidity, wrench_projector
from oracles.operational.spectrum import spectrum
from oracles.planar_linkages import five_bar, five_bar_bent

S_ON, S_OFF = 0.02, 0.05


def random_spectrum(seed, s):
    """Return a random metric factor G and the spectrum with singular values s."""
    rng = np.random.default_rng(seed)
    size = len(s)
    root = rng.normal(size=(size, size))
    g = np.linalg.cholesky(root @ root.T + 0.3 * np.eye(size))
    left, right = (np.linalg.qr(rng.normal(size=(size, size)))[0] for _ in range(2))
    return g, spectrum(left @ np.diag(s) @ right.T @ np.linalg.inv(g), g, np.linalg.inv(g).T)


def test_weight_is_one_below_zero_above_and_falls_between():
    s = np.linspace(0.0, 1.0, 20001)
    w = rigidity(s, S_ON, S_OFF)
    assert np.all(w[s <= S_ON] == 1.0)
    assert np.all(w[s >= S_OFF] == 0.0)
    between = (s > S_ON + 1e-4) & (s < S_OFF - 1e-4)
    assert np.all(np.diff(w[between]) < 0.0)
    assert rigidity(np.array([0.5 * (S_ON + S_OFF)]), S_ON, S_OFF)[0] == pytest.approx(0.5)


def test_weight_has_continuous_first_and_second_derivatives():
    step = 1e-4 * (S_OFF - S_ON)
    for edge in (S_ON, S_OFF):
        s = edge + step * np.arange(-3, 4)
        w = rigidity(s, S_ON, S_OFF)
        # 10 t^3 near the edge: slope 30 t^2 and curvature 60 t, at t = 3e-4.
        assert np.abs(np.diff(w)).max() / 1e-4 < 30 * 4e-4**2 * 1.1
        assert np.abs(np.diff(w, 2)).max() / 1e-8 < 60 * 4e-4


@pytest.mark.parametrize("seed", range(5))
def test_p_c_is_a_matrix_function_of_x(seed):
    """P_c = G w(sqrt(G^T X G)) G^T / m, computed from eigenvectors of another matrix."""
    g, found = random_spectrum(seed, [0.8, 0.06, 0.04, 0.03, 0.01, 0.0])
    weights = rigidity(found.s, S_ON, S_OFF)
    mu, vectors = np.linalg.eigh(
        np.linalg.inv(g) @ (found.wrenches * found.mu) @ found.wrenches.T @ np.linalg.inv(g).T
    )
    s = np.sqrt(np.clip(mu, 0.0, None))
    expected = g @ (vectors * rigidity(s, S_ON, S_OFF)) @ vectors.T @ g.T / 1.7
    # s = sqrt(mu) is exact to eps/s = 1e-14 where w varies, w' is 1/(s_off - s_on) = 60.
    assert relative(constraint_projector(found, weights, 1.7), expected) < 1e-11


@pytest.mark.parametrize("seed", range(5))
def test_indifferent_to_sign_order_and_choice_in_a_degenerate_subspace(seed):
    _, found = random_spectrum(seed, [0.8, 0.035, 0.035, 0.03, 0.0, 0.0])
    rng = np.random.default_rng(seed)
    mix = np.diag(np.sign(rng.normal(size=6)))
    for pair in ((1, 2), (4, 5)):
        turn = np.linalg.qr(rng.normal(size=(2, 2)))[0]
        mix[np.ix_(pair, pair)] = turn
    order = rng.permutation(6)
    other = Spectrum(
        found.s[order], (found.wrenches @ mix)[:, order], (found.duals @ mix)[:, order]
    )
    for function in (lambda f, w: constraint_projector(f, w, 1.0), wrench_projector):
        one = function(found, rigidity(found.s, S_ON, S_OFF))
        two = function(other, rigidity(other.s, S_ON, S_OFF))
        assert relative(two, one) < 1e-13  # sums of the same terms, condition of the metric


@pytest.mark.parametrize("seed", range(8))
@pytest.mark.parametrize("planar", [False, True])
def test_rigid_directions_are_balanced_entirely(seed, planar):
    terms = sample_terms(random_mechanism(seed, planar))
    rows = terms.analysis.rows
    share = terms.analysis.wrench_projector[np.ix_(rows, rows)]
    rigid = terms.analysis.constraint_wrenches[rows]
    # Products with I_l and its inverse: eps times cond(I_l) < 1e3.
    assert np.linalg.norm(share @ rigid - rigid) <= 1e-12 * np.linalg.norm(rigid)
    crisp = (terms.analysis.spectrum.s < 1e-10).astype(float)
    pi = wrench_projector(terms.analysis.spectrum, crisp)
    assert np.linalg.norm(pi @ pi - pi) <= 1e-12 * np.linalg.norm(pi)
    assert np.linalg.norm(terms.x @ pi) <= 1e-11 * terms.scale * np.linalg.norm(pi)


@pytest.mark.parametrize("seed", range(4))
def test_normalisation(seed):
    terms = sample_terms(random_mechanism(seed))
    found = terms.analysis.spectrum
    # n_i^T I_l^-1 n_j = delta_ij, and X n_i = s_i^2 I_l^-1 n_i.
    assert relative(found.duals.T @ found.wrenches, np.eye(6)) < 1e-12
    moved = terms.x @ found.wrenches - found.duals * found.mu
    assert np.linalg.norm(moved) < 1e-12 * terms.scale * np.linalg.norm(found.wrenches)
    p_c = terms.analysis.constraint_projector
    assert np.linalg.norm(p_c - p_c.T) <= 1e-15 * np.linalg.norm(p_c)
    values = scipy.linalg.eigvalsh(p_c)
    assert values[0] >= -1e-14 * max(values[-1], 0.0)


def largest_change(count):
    mechanism, bends = Mechanism(scene_from_document(five_bar())), np.linspace(-0.4, 0.4, count)
    found = [analyse(mechanism, five_bar_bent(1.9, bend), "end2") for bend in bends]
    ranks = {a.rank for a in found}
    counts = {int(np.count_nonzero(a.weights == 1.0)) for a in found}
    assert ranks == {1, 2}
    assert counts == {1, 2}
    projectors = [a.constraint_projector for a in found]
    size = max(np.linalg.norm(p) for p in projectors)
    return max(np.linalg.norm(b - a) for a, b in pairwise(projectors)) / (size)


def test_p_c_is_continuous_through_a_change_of_rank():
    """Links 3 and 4 swing through the taut position: halving the step halves the change."""
    coarse, fine = largest_change(201), largest_change(401)
    # A jump would keep its size; 2 to first order in the step of 4 mrad.
    assert coarse / fine == pytest.approx(2.0, rel=0.1)
    assert fine < 0.1
