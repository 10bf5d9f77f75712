# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0

from dataclasses import astuple

import numpy as np
import pytest

from benchmarks.graph.statuses import (
    Percentiles,
    median_of,
    percentiles_of,
    percentiles_said,
    ratios,
)


def test_percentiles_are_samples_and_never_fall() -> None:
    random = np.random.default_rng(3)
    for size in (1, 2, 7, 100, 1001):
        samples = random.exponential(100.0, size)
        found = percentiles_of(samples)
        assert found is not None
        values = astuple(found)
        assert list(values) == sorted(values)
        assert set(values) <= set(samples.tolist())
        assert found.max_us == samples.max()
        # At least the share named lies at or below, and less than it strictly below.
        for share, value in zip((0.5, 0.9, 0.99), values, strict=False):
            assert np.mean(samples <= value) >= share > np.mean(samples < value) - 1e-12


def test_percentiles_do_not_depend_on_order() -> None:
    samples = np.arange(1.0, 101.0)
    assert percentiles_of(samples) == percentiles_of(samples[::-1])
    assert percentiles_of(samples) == Percentiles(50.0, 90.0, 99.0, 100.0)


def test_nothing_has_no_percentiles() -> None:
    assert percentiles_of(np.array([])) is None
    assert median_of([]) is None
    assert percentiles_said({}, "loop_latency") is None


def test_what_a_node_says_is_read_whole_or_not_at_all() -> None:
    said = {"age_p50_us": 110.0, "age_p90_us": 150.0, "age_p99_us": 200.0, "age_max_us": 195.5}
    # The upper edge of the last bin lies above the longest.
    assert percentiles_said(said, "age") == Percentiles(110.0, 150.0, 195.5, 195.5)
    assert percentiles_said({k: v for k, v in said.items() if "p90" not in k}, "age") is None
    assert percentiles_said(dict.fromkeys(said, 0.0), "age") is None


def test_medians_are_taken_by_percentile_and_ratios_undo_scaling() -> None:
    runs = [Percentiles(1.0, 6.0, 7.0, 30.0), Percentiles(2.0, 5.0, 9.0, 20.0)]
    runs.append(Percentiles(3.0, 4.0, 8.0, 10.0))
    middle = median_of(runs)
    assert middle == Percentiles(2.0, 5.0, 8.0, 20.0)
    assert middle == median_of(runs[::-1])
    twice = Percentiles(*(2.0 * value for value in astuple(middle)))
    assert ratios(twice, middle) == pytest.approx(dict.fromkeys(("p50", "p90", "p99", "max"), 2.0))
    assert ratios(middle, middle) == dict.fromkeys(("p50", "p90", "p99", "max"), 1.0)
    assert "p50" not in ratios(middle, Percentiles(0.0, 1.0, 1.0, 1.0))
