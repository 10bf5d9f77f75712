# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The compiled analysis against the readable one."""

from itertools import product

import numpy as np
import pytest

from hapticmech_ros import load_scene
from hapticmech_ros.loading import shipped_scenes
from hapticmech_ros.operational import Analyser
from hapticmech_ros.scene import scene_from_document
from oracles.generator import closed_chain, random_mechanism
from oracles.implementations import apart, condition, falling, pair_of, sample_pair
from oracles.operational import ReadableAnalyser
from oracles.planar_linkages import five_bar, five_bar_bent
from oracles.running import with_start
from sampling import sampled

# Sums of some ten products in another order, and what D's condition (up to 1e3) takes.
ROUNDING = 1e-12


def pairs():
    for name in shipped_scenes():
        yield from (pair_of(load_scene(name), k, 0.2 * k) for k in sampled(range(4), name))
        yield pair_of(load_scene(name, changes=["task=position"]), 1, 0.2)
    for planar, duplicated in product((False, True), repeat=2):
        for seed in sampled(range(12), (planar, duplicated)):
            sample = random_mechanism(seed, planar, duplicated=duplicated)
            yield from (sample_pair(sample, away) for away in (0.0, 0.3))
    for kind in ("spherical", "revolute", "weld", "planar_pin"):
        yield from (sample_pair(closed_chain(seed, kind)) for seed in sampled(range(12), kind))


def compare(expected, found, free, falls, magnified):
    """Check every field; ``free`` is the analysis without closures, which says how large X is;
    ``falls`` is how large accelerations are that may cancel.
    """
    size = np.abs(free.inverse_inertia).max()
    assert found.rank == expected.rank
    assert (found.rows == expected.rows).all()
    assert apart(found.inverse_inertia, expected.inverse_inertia, size) < magnified
    assert (found.inverse_inertia == found.inverse_inertia.T).all()
    assert apart(found.spectrum.s, expected.spectrum.s, 1.0) < magnified
    # Slope of w: 15/8 over s_off - s_on = 0.03; and products of wrenches of different units.
    steep = 100.0 * magnified
    assert apart(found.weights, expected.weights, 1.0) < steep
    assert apart(found.constraint_projector, expected.constraint_projector) < steep
    assert apart(found.wrench_projector, expected.wrench_projector, 1.0) < steep
    assert apart(found.free_acceleration, expected.free_acceleration, falls) < magnified
    wrenches, duals = found.spectrum.wrenches, found.spectrum.duals
    assert np.abs(duals.T @ wrenches - np.eye(found.rows.size)).max() < ROUNDING
    # Bases of the null space may differ: each lies in the other's span.
    mine, others = found.constraint_wrenches, expected.constraint_wrenches
    assert mine.shape == others.shape
    if mine.shape[1]:
        coordinates = np.linalg.lstsq(others, mine, rcond=None)[0]
        # What is rigid turns into what is nearly so by the matrix's own rounding over the gap
        # between them: next to a singular position by 1e-16 / 1e-7.
        gap = expected.spectrum.s[: -mine.shape[1]].min(initial=1.0)
        turned = magnified + 1e-15 / gap
        assert np.linalg.norm(others @ coordinates - mine) < turned * np.linalg.norm(mine)


@pytest.mark.parametrize("pair", list(pairs()))
def test_analyses_are_the_same(pair):
    none = (False,) * len(pair.readable.closures)
    for active in pair.sets:
        expected, found = pair.evaluate(active)
        magnified = ROUNDING * condition(expected.space)
        for name in pair.readable.point_names:
            readable, compiled = (
                ReadableAnalyser(pair.readable, name),
                Analyser(pair.mechanism, name),
            )
            free = readable.analyse(pair.readable.evaluate(pair.q, pair.v, none))
            falls = falling(expected, readable.index)
            compare(readable.analyse(expected), compiled.analyse(found), free, falls, magnified)


def test_readable_terms_are_analysed_too():
    pair = pair_of(load_scene("five_bar"), 1, 0.2)
    expected, found = pair.evaluate((True,))
    compiled = Analyser(pair.mechanism).analyse(found)
    mixed = ReadableAnalyser(pair.mechanism).analyse(expected)
    assert apart(mixed.inverse_inertia, compiled.inverse_inertia) < ROUNDING
    found_by_readable = ReadableAnalyser(pair.readable).analyse(found)
    assert apart(found_by_readable.inverse_inertia, compiled.inverse_inertia) < ROUNDING


@pytest.mark.parametrize("bend", [0.1, 1e-3, 1e-5, 1e-7, 0.0])
def test_small_singular_values_are_the_same_up_to_the_singular_position(bend):
    # Links 3 and 4 in line at bend 0: a second direction at the end of link 2 becomes rigid.
    document = with_start(five_bar(), five_bar_bent(1.9, bend), np.array([0.1, 0.2, -0.3, 0.4]))
    pair = pair_of(scene_from_document(document))
    expected, found = pair.evaluate((True,))
    readable, compiled = ReadableAnalyser(pair.readable, "end2"), Analyser(pair.mechanism, "end2")
    free = readable.analyse(pair.readable.evaluate(pair.q, pair.v, (False,)))
    analysis = readable.analyse(expected)
    falls = falling(expected, readable.index)
    compare(analysis, compiled.analyse(found), free, falls, ROUNDING * condition(expected.space))
    assert analysis.spectrum.s[1] < 10.0 * bend + 1e-12
