# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The reported number of joint constraints: thresholds, dwell, and no flicker."""

import numpy as np
import pytest

from hapticmech_ros.operational.observation import ConstraintCounter, rigid_count
from hapticmech_ros.scene.controller import Perception

PERCEPTION = Perception(s_on=0.02, s_off=0.05, dwell=0.005)
PERIOD = 0.001


def run(s, perception=PERCEPTION, start=None):
    """Return the count after each row of s (ticks, directions)."""
    counter = ConstraintCounter(perception)
    counter.update(np.atleast_1d(s[0] if start is None else start), 0.0)
    return np.array(
        [counter.update(np.atleast_1d(row), tick * PERIOD) for tick, row in enumerate(s)]
    )


def changes(counts):
    return int(np.count_nonzero(np.diff(counts)))


@pytest.mark.parametrize("centre", [PERCEPTION.s_on, PERCEPTION.s_off])
@pytest.mark.parametrize("first", [0.0, 1.0])
def test_noise_around_one_threshold_changes_the_count_at_most_once(centre, first):
    for seed in range(5):
        noise = centre + np.random.default_rng(seed).uniform(-0.01, 0.01, 5000)
        assert changes(run(noise, start=[first])) <= 1


@pytest.mark.parametrize(("before", "after", "count"), [(1.0, 0.0, 1), (0.0, 1.0, 0)])
def test_a_change_is_told_after_exactly_the_dwell(before, after, count):
    s = np.r_[np.full(100, before), np.full(50, after)]
    counts = run(s)
    # Ticks 100..104 disagree for 0..4 ms; at tick 105 it is 5 ms.
    assert np.all(counts[:105] == 1 - count)
    assert np.all(counts[105:] == count)


def test_directions_are_counted_one_by_one_from_the_first_sample():
    assert rigid_count(np.array([0.9, 0.02, 0.0]), PERCEPTION) == 2
    s = np.tile([0.9, 0.5, 0.001], (20, 1))
    s[10:, 1] = 0.01
    counts = run(s)
    assert counts[0] == 1
    assert counts[-1] == 2
    assert changes(counts) == 1


@pytest.mark.parametrize("dwell", [0.0, 0.003])
def test_every_count_is_that_of_each_direction_s_last_whole_dwell(dwell):
    """A direction is as the last stay of a dwell and more beyond a threshold says."""
    perception, ticks = Perception(s_on=0.02, s_off=0.05, dwell=dwell), np.arange(700)
    rng, counter = np.random.default_rng(1), ConstraintCounter(perception)
    stay = round(dwell / PERIOD) + 1
    for _ in range(4):
        counter.begin()
        s = 0.035 + 0.03 * np.sin(0.05 * ticks[:, None] + np.arange(3))
        s += rng.normal(scale=0.004, size=s.shape)
        rigid = s[0] <= 0.02
        for tick in ticks:
            seen = s[max(tick - stay + 1, 0) : tick + 1]
            if len(seen) == stay:
                rigid = (rigid | (seen <= 0.02).all(axis=0)) & ~(seen >= 0.05).all(axis=0)
            assert counter.update(s[tick], tick * PERIOD) == rigid.sum()
