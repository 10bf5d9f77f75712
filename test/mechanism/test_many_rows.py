# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Closures of many rows: what QR gives is what a dense SVD gives."""

import copy
from dataclasses import replace

import numpy as np
import pytest

from benchmarks.accuracy.n_four_bar import n_four_bar
from hapticmech_ros.errors import HapticMechError
from hapticmech_ros.mechanism.kernels.many_rows import (
    cut,
    first_directions,
    pseudo_inverse_transposed,
    solve_lower_columns,
    triangularise,
)
from oracles.factorisation import factored_as_dense
from oracles.generator import closed_chain
from oracles.posed import apart, posed, posed_sample
from sampling import sampled

# As in test_terms.py.
ROUNDING = 1e-12


def repeated(seed, kind, times):
    """Return a closed chain whose only closure is written down ``times`` times."""
    sample = closed_chain(seed, kind)
    document = copy.deepcopy(sample.document)
    loop = document["closures"][0]
    document["closures"] = [{**copy.deepcopy(loop), "name": f"loop{i}"} for i in range(times)]
    return posed_sample(replace(sample, document=document))


def turned(windows, angle):
    """Return A02's mechanism on its closures, all uprights turned by ``angle`` from where it is."""
    pair = posed(n_four_bar(windows))
    return replace(pair, q=pair.mechanism.integrate(pair.q, angle * pair.v))


def pairs():
    for windows in (9, 15, 40):
        for angle in (0.0, 0.7, -1.3):
            yield turned(windows, angle)
    for seed in range(4):
        yield repeated(seed, "weld", 3)
        yield repeated(seed, "revolute", 6)
        yield repeated(seed, "planar_pin", 12)


PAIRS = list(pairs())


@pytest.mark.parametrize("pair", PAIRS)
def test_results_are_those_of_dense_ones(pair):
    factored_as_dense(pair, pair.all_closed)
    space = pair.evaluate(pair.all_closed).space
    assert apart(space.basis.T @ space.basis, np.eye(space.rank)) < ROUNDING


@pytest.mark.parametrize("windows", [9, 20])
def test_all_windows_in_line_lose_one_row_each(windows):
    pair = turned(windows, np.pi / 2.0)
    assert pair.evaluate(pair.all_closed).space.rank == windows
    factored_as_dense(pair, pair.all_closed)


@pytest.mark.parametrize("away", [1e-9, 1e-6, 1e-3])
def test_off_the_closures_what_is_cut_is_what_an_svd_cuts(away):
    pair = repeated(3, "weld", 3)
    change = away * np.cos(np.arange(pair.v.size))
    pair = replace(pair, q=pair.mechanism.integrate(pair.q, change))
    assert pair.evaluate(pair.all_closed).space.rank == 6
    factored_as_dense(pair, pair.all_closed)


def test_what_is_not_a_number_is_an_error():
    pair = turned(9, 0.0)
    q = pair.q.copy()
    q[3] = np.nan
    with pytest.raises(HapticMechError):
        pair.mechanism.closing_terms(q, pair.all_closed)


@pytest.mark.parametrize(("size", "count", "rank"), [(8, 6, 6), (8, 6, 4), (5, 9, 5), (7, 7, 1)])
def test_factors_of_a_matrix_of_any_rank(size, count, rank):
    rng = np.random.default_rng([size, count, rank])
    matrix = rng.normal(size=(size, rank)) @ rng.normal(size=(rank, count))
    upper, most = matrix.copy(), min(size, count)
    order, reflectors = np.empty(count, dtype=np.int64), np.empty((most, size))
    sums = np.empty((2, max(size, count)))
    assert triangularise(upper, most, 1e-10, order, reflectors, sums) == rank
    directions = np.empty((size, rank))
    first_directions(reflectors, rank, size, sums[0], directions)
    kept = np.triu(upper[:rank])
    assert apart(directions.T @ directions, np.eye(rank)) < 1e-14
    assert apart(directions @ kept, matrix[:, order]) < 1e-14
    inverse = np.empty((rank, count))
    pseudo_inverse_transposed(upper, rank, np.empty((3, rank * count)), sums, inverse)
    assert apart(inverse, np.linalg.pinv(kept.T)) < 1e-14 * np.linalg.cond(kept)


def test_diagonal_of_r_never_grows():
    rng = np.random.default_rng(5)
    upper = rng.normal(size=(20, 12)) * np.logspace(0, -6, 12)[rng.permutation(12)]
    order, reflectors = np.empty(12, dtype=np.int64), np.empty((12, 20))
    triangularise(upper, 12, 1e-12, order, reflectors, np.empty((2, 12)))
    diagonal = np.abs(np.diag(upper))
    assert (np.diff(diagonal) <= 0.0).all()


def test_zeros_of_a_factor_are_passed_over():
    rng = np.random.default_rng(2)
    factor = np.tril(rng.normal(size=(9, 9))) + 4.0 * np.eye(9)
    factor[3:6, :3] = 0.0
    columns = rng.normal(size=(9, 5))
    solved = columns.copy()
    solve_lower_columns(factor, solved)
    assert apart(factor @ solved, columns) < 1e-14


@pytest.mark.parametrize("seed", sampled(range(40)))
def test_what_is_cut_is_what_a_truncated_svd_cuts(seed):
    """Rows that depend on each other but for 1e-9 to 1e-5, as off the closures."""
    rng = np.random.default_rng(seed)
    n, m = rng.integers(4, 9), rng.integers(4, 10)
    rank = int(rng.integers(2, min(n, m)))
    apart_by = 10.0 ** rng.uniform(-9.0, -5.0)
    rows = rng.normal(size=(m, rank)) @ rng.normal(size=(rank, n))
    columns = (rows + apart_by * rng.normal(size=(m, n))).T
    upper, order, most = columns.copy(), np.zeros(m, dtype=int), min(n, m)
    reflectors, sums = np.zeros((most, n)), np.zeros((2, max(n, m)))
    resolved = triangularise(upper, most, 1e-11, order, reflectors, sums)
    assert resolved == most
    sigmas, directions, found = np.zeros(most), np.zeros((n, most)), np.zeros((most, m))
    workspace = np.zeros((3, most * m))
    assert cut(upper, resolved, rank, reflectors, workspace, sums, sigmas, directions, found)
    left, sigma, right = np.linalg.svd(columns[:, order], full_matrices=False)
    assert sigma[rank] < 1e-3 * sigma[rank - 1]
    basis = directions[:, :rank]
    # Singular vectors turn by rounding over the distance of the values cut from those kept.
    magnified = ROUNDING * sigma[0] / sigma[rank - 1]
    assert apart(basis @ basis.T, left[:, :rank] @ left[:, :rank].T, 1.0) < magnified
    inverse = (right[:rank].T / sigma[:rank]) @ left[:, :rank].T
    assert apart(found[:rank].T @ basis.T, inverse) < magnified
