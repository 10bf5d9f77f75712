# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0

import pytest

from benchmarks.graph.statuses import (
    ROUND_TRIP,
    Status,
    around,
    clocked,
    rate_hz,
    said,
    status_of,
)
from hapticmech_ros.numerics.times import NANOSECONDS, nanoseconds
from hapticmech_ros.wire.topics import DEVICE


def spoken(seconds: float, node: str = DEVICE, **figures: float) -> Status:
    return Status(node, nanoseconds(seconds), "rendering", figures)


def test_the_statuses_around_a_window_are_the_nearest_outside() -> None:
    received = [spoken(second) for second in (1.0, 2.0, 3.0, 4.0, 5.0, 6.0)]
    window = (nanoseconds(2.5), nanoseconds(4.5))
    ends = around([*received, spoken(2.4, "other")], DEVICE, window)
    assert ends is not None
    assert [status.stamp_ns / NANOSECONDS for status in ends] == [2.0, 5.0]
    assert around(received[:4], DEVICE, window) is None
    assert around(received[2:], DEVICE, window) is None


def test_a_clocked_node_publishes_what_it_does_not_miss() -> None:
    ends = (
        spoken(10.0, periods=5000, missed_deadlines=100, dropped_periods=1),
        spoken(14.0, periods=9000, missed_deadlines=104, dropped_periods=1),
    )
    kept = clocked(ends)
    assert (kept.periods, kept.missed, kept.dropped) == (4000, 4, 0)
    assert kept.rate_hz == pytest.approx((4000 - 4) / 4.0)
    assert rate_hz(ends, "periods") == pytest.approx(1000.0)
    assert rate_hz((ends[0], ends[0]), "periods") == 0.0


def test_lines_of_the_probe_become_figures_and_words_that_are_none_are_left_out() -> None:
    status = status_of(
        {
            "event": "status",
            "node": DEVICE,
            "stamp_ns": 7,
            "message": "rendering",
            "figures": {"periods": "12", "last_refusal": "none", "odd": "nan", "share": "0.5"},
        }
    )
    assert status == Status(DEVICE, 7, "rendering", {"periods": 12.0, "share": 0.5})


def test_latencies_are_those_of_the_windows_end() -> None:
    first, second = (
        spoken(
            second,
            loop_latency_p50_us=value,
            loop_latency_p90_us=value,
            loop_latency_p99_us=value,
            loop_latency_max_us=value,
        )
        for second, value in ((1.0, 100.0), (2.0, 200.0))
    )
    found = said({DEVICE: (first, second)})
    assert set(found) == {ROUND_TRIP}
    assert found[ROUND_TRIP].p50_us == 200.0
