# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Counterexamples to Eqs. 2-12 as the paper prints them (docs/derivations.md gives the proofs)."""

import numpy as np
import pytest

from oracles import closed_form
from oracles.analysed import sample_terms, terms_of
from oracles.differences import relative
from oracles.generator import random_mechanism
from oracles.planar_linkages import five_bar, five_bar_bent

# Corrected forms agree with the null-space formula to eps times cond(D) < 1e4.
AGREES = 1e-11
# Printed forms are off by this much or more, of the size of X: no rounding.
WRONG = 0.05


def five_bar_terms():
    return terms_of(five_bar(), five_bar_bent(1.9, 0.6), point="end2")


def printed_eq_3(terms, closure_jacobian):
    """Return Eq. 3 as printed, with (W D^-1 W^T) where its pseudo-inverse should be."""
    weighted = np.linalg.solve(terms.d, closure_jacobian.T)
    middle = weighted @ (closure_jacobian @ weighted) @ weighted.T
    return terms.j @ (np.linalg.inv(terms.d) - middle) @ terms.j.T


def test_erratum_1_eq_3_lacks_an_inverse():
    terms = five_bar_terms()
    truth = closed_form.inverse_inertia(terms.d, terms.w, terms.j)
    assert relative(terms.x, truth) < AGREES
    printed = printed_eq_3(terms, terms.w)
    assert relative(printed, truth) > WRONG
    # It even depends on the unit in which the closure is written, millimetres for metres:
    in_millimetres = printed_eq_3(terms, 1e3 * terms.w)
    assert relative(in_millimetres, printed) > 1.0
    # ...and then gives wrenches that push the point backwards.
    assert np.linalg.eigvalsh(in_millimetres)[0] < 0.0


def printed_eq_12(d, w, j):
    """Return Eq. 12: drop the first r eigenvectors of D^-1, whatever the directions of W."""
    values, vectors = np.linalg.eigh(np.linalg.inv(d))
    kept = values.copy()
    kept[: closed_form.rank(w)] = 0.0
    return j @ (vectors * kept) @ vectors.T @ j.T


def test_erratum_2_y_does_not_commute_with_a():
    """Two degrees of freedom, D^-1 = diag(1, 4), one closure along (1, 1)."""
    a, r = np.diag([1.0, 4.0]), np.eye(2)
    w = np.array([[1.0, 1.0]])
    u = np.linalg.svd(w)[2].T
    for y in (r @ u, u @ r):  # what Eq. 6 contains, and what Eq. 7 says it contains
        assert relative(y.T @ a @ y, a) > WRONG
    # W D^-1 W^T is 5; Eq. 8 says a_1 sigma_1^2 = 2 (or 8, with the other order of the a_i).
    assert (w @ a @ w.T).item() == pytest.approx(5.0, rel=1e-14)


@pytest.mark.parametrize("order", [1, -1])
def test_erratum_2_the_closed_form_12_ignores_the_directions_of_w(order):
    d = np.diag(1.0 / np.array([1.0, 4.0])[::order])
    j = np.eye(2)
    one, other = np.array([[1.0, 1.0]]), np.array([[1.0, -2.0]])
    x_one = closed_form.inverse_inertia(d, one, j)
    x_other = closed_form.inverse_inertia(d, other, j)
    assert relative(x_other, x_one) > WRONG
    assert np.array_equal(printed_eq_12(d, one, j), printed_eq_12(d, other, j))


def test_erratum_2_the_closed_form_12_fails_on_the_five_bar():
    terms = five_bar_terms()
    truth = closed_form.inverse_inertia(terms.d, terms.w, terms.j)
    assert relative(printed_eq_12(terms.d, terms.w, terms.j), truth) > WRONG


@pytest.mark.parametrize("link", [1, 2])
def test_erratum_3_serial_chains_are_not_positive_definite_in_general(link):
    """The paper's own chain, cut open: r = 0, and a wrench that moves nothing."""
    terms = terms_of(five_bar(closed=False), five_bar_bent(1.9, 0.6), point=f"end{link}")
    assert terms.w.shape[0] == 0
    assert terms.analysis.rank == link < 3
    wrench = terms.analysis.constraint_wrenches[terms.analysis.rows, 0]
    # J^T F = 0: rounding of J's entries against |J| |F|.
    force = np.linalg.norm(terms.j.T @ wrench)
    assert force < 1e-14 * np.linalg.norm(terms.j) * np.linalg.norm(wrench)


@pytest.mark.parametrize("seed", range(10))
def test_erratum_3_definite_if_and_only_if_j_has_full_rank(seed):
    terms = sample_terms(random_mechanism(seed, closed=False))
    assert (terms.analysis.rank == 6) == (closed_form.rank(terms.j) == 6)


def test_erratum_4_r_may_equal_m():
    terms = five_bar_terms()
    assert terms.evaluation.space.rank == terms.w.shape[0] == 2


def test_erratum_4_lambda_q_is_no_product():
    terms = five_bar_terms()
    _, forces = terms.evaluation.acceleration(np.ones(4))
    assert forces.shape == (2,)
    assert terms.mechanism.nq == 4


def test_erratum_4_a_configuration_without_motion_has_no_energy():
    terms = five_bar_terms()
    q = five_bar_bent(1.9, 0.6)
    assert np.linalg.norm(q) > 1.0
    assert terms.mechanism.energy(q, np.zeros(4))[0] == 0.0
    values = np.linalg.eigvalsh(terms.d)
    assert values[0] > 1e-3 * values[-1]


def test_erratum_4_the_inverse_in_9_is_a_pseudo_inverse():
    """Duplicated closures: W D^-1 W^T has no inverse, X is what it was."""
    once = random_mechanism(1, True)
    twice = random_mechanism(1, True, duplicated=True)
    single, double = sample_terms(once), sample_terms(twice)
    product = double.w @ np.linalg.solve(double.d, double.w.T)
    assert np.linalg.cond(product) > 1e14
    pseudo = np.linalg.pinv(product, rcond=1e-12)
    weighted = np.linalg.solve(double.d, double.w.T)
    corrected = double.j @ (np.linalg.inv(double.d) - weighted @ pseudo @ weighted.T) @ double.j.T
    assert relative(double.x, corrected, scale=double.scale) < AGREES
    assert relative(double.x, single.x, scale=double.scale) < AGREES
