# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What a controller needs of a point, in one go, against the analysis and the terms of Eq. 1."""

import numpy as np
import pinocchio as pin
import pytest

from hapticmech_ros import load_scene
from hapticmech_ros.errors import HapticMechError
from hapticmech_ros.layout import OPERATIONAL_MODEL
from hapticmech_ros.loading import shipped_scenes
from hapticmech_ros.mechanism.inertia import SingularInertiaError
from hapticmech_ros.operational import Analyser
from hapticmech_ros.scene import scene_from_document
from oracles.generator import closed_chain, random_mechanism
from oracles.implementations import apart, condition, falling, pair_of, sample_pair
from oracles.operational import ReadableAnalyser
from oracles.planar_linkages import INERTIAS, LENGTHS, MASSES, chain
from sampling import sampled

# Sums of some ten products in another order, and what D's condition (up to 1e3) takes.
ROUNDING = 1e-12
SIZE = OPERATIONAL_MODEL.slice("s", "twist").stop
X, FREE, MOVES = (
    OPERATIONAL_MODEL.slice(name) for name in ("inverse_inertia", "free_acceleration", "twist")
)


def pairs():
    for name in shipped_scenes():
        yield from (pair_of(load_scene(name), k, 0.2 * k) for k in sampled(range(4), name))
        yield pair_of(load_scene(name, changes=["task=position"]), 1, 0.2)
    for seed in sampled(range(8), every=2):
        yield sample_pair(random_mechanism(seed, seed % 2 == 0, duplicated=seed % 3 == 0), 0.3)
        yield sample_pair(closed_chain(seed, ("spherical", "revolute", "weld")[seed % 3]))


def seen(analyser, pair, active):
    return analyser.observe(pair.q, pair.v, active).model[:SIZE]


@pytest.mark.parametrize("pair", list(pairs()))
def test_both_see_the_same(pair):
    for active in pair.sets:
        terms = pair.readable.evaluate(pair.q, pair.v, active)
        magnified = ROUNDING * condition(terms.space)
        free = pair.readable.evaluate(pair.q, pair.v, (False,) * len(active))
        for name in pair.readable.point_names:
            readable, compiled = (
                ReadableAnalyser(pair.readable, name),
                Analyser(pair.mechanism, name),
            )
            one, other = seen(readable, pair, active), seen(compiled, pair, active)
            alone = readable.analyse(free)
            inertia, falls = np.abs(alone.inverse_inertia).max(), falling(terms, readable.index)
            assert apart(other[:6], one[:6], 1.0) < magnified
            assert apart(other[X], one[X], inertia) < magnified
            # Slope of w, and products of wrenches of different units.
            assert apart(other[42:78], one[42:78]) < 100.0 * magnified
            assert apart(other[78:114], one[78:114], 1.0) < 100.0 * magnified
            assert apart(other[FREE], one[FREE], falls) < magnified
            assert apart(other[120:127], one[120:127], 1.0) < ROUNDING
            assert apart(other[MOVES], one[MOVES], np.abs(pair.v).max()) < ROUNDING


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


def test_quaternions_of_all_orientations_are_eigens():
    pair = sample_pair(random_mechanism(1, False))
    analyser = Analyser(pair.mechanism)
    rng = np.random.default_rng(0)
    signs = set()
    for _ in range(200):
        pair.q[:] = pair.mechanism.integrate(pair.q, rng.normal(size=pair.v.size))
        pose = pair.readable.frame_pose(pair.q, pair.readable.point_names[0])
        expected = pin.Quaternion(pose.rotation).coeffs()
        found = seen(analyser, pair, pair.readable.initially_active)[123:127]
        # Near a change of the largest component, it may be the other sign: the same rotation.
        assert min(np.abs(found - expected).max(), np.abs(found + expected).max()) < ROUNDING
        signs.add((int(np.argmax(np.abs(expected))), bool(expected[3] > 0.0)))
    assert len(signs) > 4


def test_what_cannot_be_seen_is_an_error():
    # Two hinges on one axis move the same mass: only D itself shows it.
    document = chain(LENGTHS, MASSES, INERTIAS)
    nothing = {"mass": 0.0, "inertia": {"ixx": 0.0, "iyy": 0.0, "izz": 0.0}}
    document["links"][-2]["inertial"] = nothing
    document["links"][-1]["joint"]["origin"] = {"xyz": [0.0, 0.0, 0.0]}
    document["operational_points"] = document["operational_points"][:2]
    pair = pair_of(scene_from_document(document))
    with pytest.raises(SingularInertiaError, match="'joint4' moves no mass"):
        seen(Analyser(pair.mechanism), pair, ())


def test_a_state_that_is_not_finite_is_an_error():
    pair = pair_of(load_scene("five_bar"))
    pair.q[1] = np.nan
    with pytest.raises(HapticMechError):
        seen(Analyser(pair.mechanism), pair, (True,))
