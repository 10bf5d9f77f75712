# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What factorisations of closures do, against dense ones; terms are copies; errors are named."""

from itertools import product

import numpy as np
import pytest

from hapticmech_ros import load_scene
from hapticmech_ros.errors import HapticMechError
from hapticmech_ros.loading import shipped_scenes
from hapticmech_ros.mechanism import Mechanism
from hapticmech_ros.numerics.small_matrices import orthogonalise
from hapticmech_ros.scene import scene_from_document
from oracles.factorisation import factored_as_dense
from oracles.generator import closed_chain, random_mechanism
from oracles.planar_linkages import INERTIAS, LENGTHS, MASSES, bar, five_bar
from oracles.posed import posed, posed_sample
from sampling import sampled

# Sums of some ten products, each rounded to 1e-16, in another order; cancellation within a field
# is bounded by its own size. Factors of D lose what D's condition takes, here up to 1e3.
ROUNDING = 1e-12
KINDS = ("spherical", "revolute", "weld", "planar_pin")


def samples():
    for planar, duplicated in product((False, True), repeat=2):
        for seed in sampled(range(12), (planar, duplicated)):
            yield random_mechanism(seed, planar, duplicated=duplicated)
    for kind in KINDS:
        yield from (closed_chain(seed, kind) for seed in sampled(range(12), kind))


def pairs():
    """Return every shipped scene and many random ones, on their closures and away from them."""
    for name in shipped_scenes():
        yield from (posed(load_scene(name), k, 0.2 * k) for k in sampled(range(4), name))
    # 1e-6 off the closures, doubled ones must still count once, though their rows differ by 1e-6.
    for sample in samples():
        yield from (posed_sample(sample, away) for away in (0.0, 1e-6, 0.3))


PAIRS = list(pairs())
CASES = [(pair, active) for pair in PAIRS for active in sorted(pair.sets)]


@pytest.mark.parametrize(("pair", "active"), CASES)
def test_factorisations_do_what_dense_ones_do(pair, active):
    factored_as_dense(pair, active)


@pytest.mark.parametrize("pair", PAIRS)
def test_distances_of_closures_are_those_of_their_rows(pair):
    count = len(pair.mechanism.closures)
    for index in range(count):
        terms = pair.evaluate(tuple(other == index for other in range(count)))
        residual = terms.closure_residual
        expected, rate = np.linalg.norm(residual), residual @ (terms.closure_jacobian @ pair.v)
        found, found_rate = pair.mechanism.distance_of(index, pair.q, pair.v)
        assert abs(found - expected) < ROUNDING * max(expected, 1.0)
        # The direction of φ is known to rounding over its length.
        assert abs(found_rate * expected - rate) < ROUNDING * max(np.linalg.norm(pair.v), 1.0)


def test_results_are_copies():
    pair = posed(load_scene("five_bar"), 1, 0.2)
    terms = pair.evaluate((True,))
    before = [part.tobytes() for part in terms[:5]]
    held = terms.points[0].pose.homogeneous, terms.points[0].jacobian.copy()
    pair.mechanism.evaluate(pair.q + 0.1, pair.v + 1.0, (True,))
    assert [part.tobytes() for part in terms[:5]] == before
    assert (terms.points[0].pose.homogeneous == held[0]).all()
    assert (terms.points[0].jacobian == held[1]).all()


def test_states_that_cannot_be_written_are_taken():
    pair = posed(load_scene("five_bar"), 1, 0.2)
    expected = pair.mechanism.evaluate(pair.q, pair.v, (True,)).bias_force
    for array in (pair.q, pair.v):
        array.flags.writeable = False
    assert (pair.mechanism.evaluate(pair.q, pair.v, (True,)).bias_force == expected).all()


def test_closures_that_are_not_finite_are_an_error():
    mechanism = Mechanism(scene_from_document(five_bar()))
    mechanism._single[0].model.units[-1] = np.nan
    with pytest.raises(HapticMechError, match="SVD"):
        mechanism.distance_of(0, np.zeros(4), np.zeros(4))


def test_one_rate_is_a_mechanism_too():
    terms = posed(scene_from_document(bar())).evaluate(())
    moment = INERTIAS[0] + MASSES[0] * (LENGTHS[0] / 2.0) ** 2
    assert terms.inertia == pytest.approx(np.array([[moment]]))
    jacobian = terms.points[0].jacobian[:, 0]
    assert jacobian[2:] == pytest.approx([0.0, 0.0, 0.0, 1.0])


@pytest.mark.parametrize("shape", [(1, 1), (2, 4), (5, 3), (6, 6), (12, 7)])
@pytest.mark.parametrize("spread", [0.0, 8.0, 15.0])
def test_small_svd_is_lapacks(shape, spread):
    rng = np.random.default_rng(shape)
    count = min(shape)
    left, _ = np.linalg.qr(rng.normal(size=(shape[0], count)))
    right, _ = np.linalg.qr(rng.normal(size=(shape[1], count)))
    matrix = (left * np.logspace(0.0, -spread, count)) @ right.T
    rows, turn = np.array(matrix, order="C"), np.empty((shape[0], shape[0]))
    assert orthogonalise(rows, turn)
    lengths = np.linalg.norm(rows, axis=1)
    expected = np.linalg.svd(matrix, compute_uv=False)
    # Absolute, as LAPACK's own are: a few roundings of the largest, which is 1.
    assert np.abs(lengths[:count] - expected).max() < 1e-14
    assert np.abs(lengths[count:]).max(initial=0.0) < 1e-14
    # Longest first, where they differ by more than the rounding of a length.
    assert (np.diff(lengths) <= 1e-15).all()
    assert np.abs(turn @ turn.T - np.eye(shape[0])).max() < 1e-14
    assert np.abs(turn @ matrix - rows).max() < 1e-14
    kept = lengths > 1e-8
    units = rows[kept] / lengths[kept][:, None]
    assert np.abs(units @ units.T - np.eye(kept.sum())).max() < 1e-13


def test_small_svd_of_nothing_and_of_nan():
    turn = np.empty((2, 2))
    assert orthogonalise(np.zeros((2, 3)), turn)
    assert not orthogonalise(np.array([[1.0, np.nan], [0.0, 1.0]]), turn)
