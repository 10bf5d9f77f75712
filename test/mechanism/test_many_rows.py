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
