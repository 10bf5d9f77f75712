# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0


import numpy as np
import pytest

from benchmarks.children import BenchError
from benchmarks.graph.statuses import (
    DROPPED,
    MISSED,
    RATE,
    ROUND_TRIP,
    Status,
    around,
    latency,
    latency_of,
    latency_said,
    said,
)
from hapticmech_ros.nodes.entry import NODES
from hapticmech_ros.numerics.times import NANOSECONDS, nanoseconds
from hapticmech_ros.wire.topics import CONTROLLER, DEVICE


def spoken(seconds: float, node: str = DEVICE, **figures: float) -> Status:
    return Status(node, nanoseconds(seconds), "rendering", figures)


def test_the_statuses_around_a_window_are_the_nearest_outside() -> None:
    received = [spoken(second) for second in (1.0, 2.0, 3.0, 4.0, 5.0, 6.0)]
    window = (nanoseconds(2.5), nanoseconds(4.5))
    ends = around([*received, spoken(2.4, "other")], DEVICE, window)
    assert ends is not None
    assert [status.stamp_ns / NANOSECONDS for status in ends] == [2.0, 5.0]
    for half in (received[:4], received[2:]):
        with pytest.raises(BenchError, match="before and after the window"):
            around(half, DEVICE, window)


def test_a_clocked_node_publishes_what_it_does_not_miss() -> None:
    counted = [
        {"periods": 5000, "missed_deadlines": 100, "dropped_periods": 1, "answers": 0},
        {"periods": 9000, "missed_deadlines": 104, "dropped_periods": 1, "answers": 1998},
    ]
    counted[1] |= {f"loop_latency_{one}_us": 200.0 for one in ("p50", "p90", "p99", "max")}
    ends = [
        {node: spoken(at, node, **figures) for node in NODES}
        for at, figures in zip((10.0, 14.0), counted, strict=True)
    ]
    found = said({node: (ends[0][node], ends[1][node]) for node in NODES})
    assert found[f"{DEVICE}: {RATE}"] == pytest.approx((4000 - 4) / 4.0)
    assert found[f"{DEVICE}: {MISSED}"] == pytest.approx(0.1)
    assert found[f"{DEVICE}: {DROPPED}"] == 0
    assert found[f"{CONTROLLER}: samples answered, %"] == pytest.approx(50.0)
    # Those of the window's end.
    assert found[latency(ROUND_TRIP, "p50")] == 200.0


def test_percentiles_are_samples_and_nothing_has_none() -> None:
    samples = np.arange(1.0, 101.0)
    assert list(latency_of("it", samples[::-1]).values()) == [50.0, 90.0, 99.0, 100.0]
    assert latency_of("it", np.array([])) == {}


def test_what_a_node_says_is_read_whole_or_not_at_all() -> None:
    told = {"age_p50_us": 110.0, "age_p90_us": 150.0, "age_p99_us": 200.0, "age_max_us": 195.5}
    # The upper edge of the last bin lies above the longest.
    assert list(latency_said("it", told, "age").values()) == [110.0, 150.0, 195.5, 195.5]
    assert latency_said("it", {k: v for k, v in told.items() if "p90" not in k}, "age") == {}
    assert latency_said("it", dict.fromkeys(told, 0.0), "age") == {}
