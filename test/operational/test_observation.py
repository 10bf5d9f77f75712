# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What a controller needs of a point, in one go, against the analysis and the terms of Eq. 1."""

import numpy as np
import pinocchio as pin
import pytest

from hapticmech_ros import load_scene
from hapticmech_ros.errors import HapticMechError
from hapticmech_ros.loading import shipped_scenes
from hapticmech_ros.mechanism.inertia import SingularInertiaError
from hapticmech_ros.numerics.layout import OperationalModelSample
from hapticmech_ros.operational import Analyser
from hapticmech_ros.scene import scene_from_document
from oracles.generator import closed_chain, random_mechanism
from oracles.planar_linkages import INERTIAS, LENGTHS, MASSES, chain
from oracles.posed import apart, condition, falling, posed, posed_sample
from sampling import sampled

# Sums of some ten products in another order, and what D's condition (up to 1e3) takes.
ROUNDING = 1e-12
SIZE = OperationalModelSample.layout.slice("s", "twist").stop
X, FREE, MOVES = (
    OperationalModelSample.layout.slice(name)
    for name in ("inverse_inertia", "free_acceleration", "twist")
)


def pairs():
    for name in shipped_scenes():
        yield from (posed(load_scene(name), k, 0.2 * k) for k in sampled(range(4), name))
        yield posed(load_scene(name, changes=["task=position"]), 1, 0.2)
    for seed in sampled(range(8), every=2):
        yield posed_sample(random_mechanism(seed, seed % 2 == 0, duplicated=seed % 3 == 0), 0.3)
        yield posed_sample(closed_chain(seed, ("spherical", "revolute", "weld")[seed % 3]))


def metric_of(analyser, point):
    """Return G of the link's inertia I_l = G Gᵀ, in world axes."""
    turn = np.kron(np.eye(2), point.pose.rotation @ analyser.metric.point_to_link)
    return turn[np.ix_(analyser.rows, analyser.rows)] @ analyser.metric.factor


def seen(analyser, pair, active):
    return analyser.observe(pair.q, pair.v, active).model[:SIZE]


@pytest.mark.parametrize("pair", list(pairs()))
def test_points_are_analysed_as_by_dense_formulas(pair):
    """X from independent rates, or where closures are not met of W's kept directions."""
    for active in pair.sets:
        terms = pair.evaluate(active)
        space = terms.space
        magnified = ROUNDING * condition(space)
        for index, name in enumerate(pair.mechanism.point_names):
            analyser, point = Analyser(pair.mechanism, name), terms.points[index]
            found = analyser.observe(pair.q, pair.v, active).model[:SIZE]
            rows = np.ix_(analyser.rows, analyser.rows)
            lifted = np.linalg.solve(space.factor, point.jacobian.T)
            free = lifted - space.basis @ (space.basis.T @ lifted)
            x, size = found[X].reshape(6, 6), np.abs(lifted.T @ lifted).max()
            assert apart(x[rows], (free.T @ free)[rows], size) < magnified
            assert np.count_nonzero(x) == np.count_nonzero(x[rows])
            metric = metric_of(analyser, point)
            mu = np.linalg.eigvalsh(metric.T @ x[rows] @ metric)[::-1]
            count = analyser.rows.size
            assert found[:count] ** 2 == pytest.approx(mu, abs=100.0 * magnified)
            own = point.jacobian @ terms.acceleration(np.zeros(pair.v.size))[0] + point.drift
            assert apart(found[FREE], own, falling(terms, index)) < magnified
            assert apart(found[120:127], pin.SE3ToXYZQUAT(point.pose), 1.0) < ROUNDING
            assert apart(found[MOVES], point.twist, np.abs(pair.v).max()) < ROUNDING


@pytest.mark.parametrize("pair", list(pairs()))
def test_in_one_go_or_not_is_the_same_to_the_bit(pair):
    for active in pair.sets:
        terms = pair.mechanism.evaluate(pair.q, pair.v, active)
        analyser = Analyser(pair.mechanism)
        found, point = analyser.analyse(terms), terms.points[analyser.index]
        filled = seen(analyser, pair, active)
        assert (filled[: found.rows.size] == found.spectrum.s).all()
        assert (filled[found.rows.size : 6] == 0.0).all()
        squares = filled[6:114].reshape(3, 6, 6)
        assert (squares[0] == found.inverse_inertia).all()
        assert (squares[1] == found.constraint_projector).all()
        assert (squares[2] == found.wrench_projector).all()
        assert (filled[FREE] == found.free_acceleration).all()
        assert (filled[120:123] == point.pose.translation).all()
        assert (filled[MOVES] == point.twist).all()


def test_what_cannot_be_seen_is_an_error():
    # Two hinges on one axis move the same mass: only D itself shows it.
    document = chain(LENGTHS, MASSES, INERTIAS)
    nothing = {"mass": 0.0, "inertia": {"ixx": 0.0, "iyy": 0.0, "izz": 0.0}}
    document["links"][-2]["inertial"] = nothing
    document["links"][-1]["joint"]["origin"] = {"xyz": [0.0, 0.0, 0.0]}
    document["operational_points"] = document["operational_points"][:2]
    pair = posed(scene_from_document(document))
    with pytest.raises(SingularInertiaError, match="'joint4' moves no mass"):
        seen(Analyser(pair.mechanism), pair, ())


def test_a_state_that_is_not_finite_is_an_error():
    pair = posed(load_scene("five_bar"))
    pair.q[1] = np.nan
    with pytest.raises(HapticMechError):
        seen(Analyser(pair.mechanism), pair, (True,))
