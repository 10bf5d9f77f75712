# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The smooth choice of constrained directions: weights, P_c and the balanced share."""

from itertools import pairwise

import numpy as np
import pytest
import scipy.linalg

from hapticmech_ros.mechanism import Mechanism
from hapticmech_ros.operational import analyse
from hapticmech_ros.scene import scene_from_document
from oracles.analysed import sample_terms, terms_of
from oracles.differences import relative
from oracles.generator import random_mechanism
from oracles.planar_linkages import five_bar, five_bar_bent

S_ON, S_OFF = 0.02, 0.05
FIVE_BAR = Mechanism(scene_from_document(five_bar()))


def at_bend(bend):
    """Return s, w, P_c of the five-bar's second link, which links 3 and 4 in line hold."""
    found = analyse(FIVE_BAR, five_bar_bent(1.9, bend), "end2")
    return found.spectrum.s, found.weights, found.constraint_projector


def test_weight_is_one_below_zero_above_and_falls_between():
    bends = np.linspace(0.0, 0.4, 2001)
    s, w = (np.array(part)[:, 1] for part in zip(*(at_bend(b)[:2] for b in bends), strict=True))
    assert np.all(w[s <= S_ON] == 1.0)
    assert np.all(w[s >= S_OFF] == 0.0)
    between = (s > S_ON + 1e-4) & (s < S_OFF - 1e-4)
    assert between.sum() > 50
    assert np.all(np.diff(w[between]) < 0.0)
    # Between, first and second derivative begin and end at 0: of degree 5 that is one polynomial.
    t = (S_OFF - s[between]) / (S_OFF - S_ON)
    ends = np.array([[1, 1, 1], [3, 4, 5], [6, 12, 20]])
    weights = t ** np.array([[3], [4], [5]]) * np.linalg.solve(ends, [1.0, 0.0, 0.0])[:, None]
    assert w[between] == pytest.approx(weights.sum(axis=0), abs=1e-12)


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("bend", [0.0, 0.06, 0.1, 0.3])
def test_p_c_and_pi_are_matrix_functions_of_x(seed, bend):
    """P_c = G w(sqrt(G^T X G)) G^T / m, of any factor G of I_l; Pi = P_c m I_l^-1."""
    metric = {"mass": 0.7, "length": 0.05}
    document = five_bar()
    point = document["operational_points"][2] | {"metric": metric}
    terms = terms_of(document | {"operational_points": [point]}, five_bar_bent(1.9, bend))
    turn = np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))[0]
    inertia = np.diag([0.7, 0.7, 0.7 * 0.05**2])
    g = np.sqrt(inertia) @ turn
    mu, vectors = np.linalg.eigh(g.T @ terms.x @ g)
    t = np.clip((S_OFF - np.sqrt(np.clip(mu, 0.0, None))) / (S_OFF - S_ON), 0.0, 1.0)
    chosen = g @ (vectors * (t**3 * (10.0 - 15.0 * t + 6.0 * t**2))) @ vectors.T @ g.T
    rows = np.ix_(terms.analysis.rows, terms.analysis.rows)
    # s = sqrt(mu) is exact to eps/s = 1e-14 where w varies, w' is 1/(s_off - s_on) = 60.
    assert relative(terms.analysis.constraint_projector[rows], chosen / 0.7) < 1e-11
    assert relative(terms.analysis.wrench_projector[rows], chosen @ np.linalg.inv(inertia)) < 1e-11


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
    found = terms.analysis.spectrum
    pi = (found.wrenches * crisp) @ found.duals.T
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
    bends = np.linspace(-0.4, 0.4, count)
    found = [analyse(FIVE_BAR, five_bar_bent(1.9, bend), "end2") for bend in bends]
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
