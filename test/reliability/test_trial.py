# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What is read from the watcher's samples: each fault that a device can have is seen."""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from benchmarks.reliability.doubles import first_heard, grown, silent_from
from benchmarks.reliability.sample import COMMAND, DEVICE, SAMPLE
from benchmarks.reliability.trial import Fault, Seen, Trial, seen, summarised
from hapticmech_ros.nodes.node_time import wall_ahead_ns

MS = 1_000_000
CLOSE = 1e-5
ZERO_GOAL = "zero force after, by the device's stamps, worst"


class Samples:
    """A device's samples of 1 ms each, as if a watcher had seen them."""

    def __init__(self) -> None:
        self.begun_ns = time.monotonic_ns() - 10_000 * MS
        self.apart_ns = wall_ahead_ns()
        self.rows: list[tuple[int, int, int, int, float, float]] = []

    def at(self, ms: float) -> int:
        return self.begun_ns + round(ms * MS)

    def push(
        self, begin_ms: int, end_ms: int, force: float, topic: int = DEVICE, late_ms: float = 0.2
    ) -> None:
        for ms in range(begin_ms, end_ms):
            stamp = self.at(ms) + self.apart_ns
            self.rows.append((topic, self.at(ms + late_ms), stamp, ms, force, 0.0))

    def seen(self, fault: Fault) -> Seen:
        rows = [row for row in self.rows if row[0] in fault.topics]
        return seen(np.array(rows, SAMPLE), fault)


def test_a_device_that_lets_go_and_comes_back() -> None:
    samples = Samples()
    samples.push(0, 112, 0.5)
    samples.push(112, 400, 0.0)
    samples.push(400, 500, 0.5)
    found = samples.seen(Fault("kill", 0, samples.at(99.9), samples.at(300)))
    assert found.zero_s == pytest.approx(0.0121, abs=CLOSE)
    assert found.heard_s == pytest.approx(0.0123, abs=CLOSE)
    assert found.back_s == pytest.approx(0.1, abs=CLOSE)


def test_force_that_returns_while_the_fault_lasts_is_no_zero() -> None:
    samples = Samples()
    samples.push(0, 112, 0.5)
    samples.push(112, 200, 0.0)
    samples.push(200, 201, 0.1)
    samples.push(201, 400, 0.0)
    found = samples.seen(Fault("double", 0, samples.at(99.9), samples.at(300)))
    assert found.zero_s == pytest.approx(0.1011, abs=CLOSE)


def test_a_torque_alone_is_a_push_and_so_is_what_is_no_number() -> None:
    for force, torque in ((0.0, 0.1), (math.nan, 0.0), (0.0, math.nan)):
        samples = Samples()
        samples.push(0, 100, 0.5)
        samples.rows.append(
            (DEVICE, samples.at(150.2), samples.at(150) + samples.apart_ns, 150, force, torque)
        )
        samples.push(151, 152, 0.0)
        found = samples.seen(Fault("kill", 0, samples.at(99.9), samples.at(300)))
        assert found.zero_s == pytest.approx(0.0511, abs=CLOSE)


def test_force_after_a_pause_of_the_devices_process_is_told_apart() -> None:
    for pause_ms, before_ms, paused in ((1, 0, False), (2, 5, False), (3, 5, True), (8, 0, True)):
        samples = Samples()
        samples.push(0, 112, 0.5)
        samples.push(112, 400, 0.0)
        samples.push(400, 650, 0.5)
        samples.push(650 + pause_ms - 1, 650 + pause_ms + before_ms, 0.5)
        samples.push(650 + pause_ms + before_ms, 660 + pause_ms + before_ms, 0.8)
        samples.push(660 + pause_ms + before_ms, 900, 0.5)
        found = samples.seen(Fault("kill", 0, samples.at(99.9), samples.at(300)))
        assert found.peak == 0.8
        assert found.pause_s == pytest.approx(1e-3 * pause_ms, abs=CLOSE)
        trial = Trial(0.0, 0.0, 0.1, found.peak, fault="kill", said="it", pause_s=found.pause_s)
        assert trial.paused is paused
        # One that is left out is a figure of its own, and all that are not keep the limit.
        gentle = replace(trial, peak=0.5, pause_s=0.0)
        figures = {one.name: one for one in summarised("it", [trial, gentle], 0.5)}
        largest = figures["it: largest force, of a clean run's"]
        left_out = figures["it: the same in trials left out"]
        assert largest.kept is paused
        assert (largest.value, left_out.value) == ((1.0, 1.6) if paused else (1.6, 0.0))
        assert (largest.trials, left_out.trials) == ((1, 1) if paused else (2, 0))


def test_a_device_that_never_lets_go_or_is_silent_never_was_at_zero() -> None:
    samples = Samples()
    samples.push(0, 500, 0.5)
    fault = Fault("step", 0, samples.at(99.9), samples.at(99.9))
    assert math.isinf(samples.seen(fault).zero_s)
    assert not samples.seen(fault).came_back
    assert math.isinf(Samples().seen(fault).zero_s)


def test_stamps_of_a_stepped_clock_tell_the_same() -> None:
    samples = Samples()
    samples.push(0, 100, 0.5)
    samples.apart_ns -= 600_000 * MS
    samples.push(100, 107, 0.5)
    samples.push(107, 200, 0.0)
    samples.push(200, 300, 0.5)
    fault = Fault("step", 0, samples.at(99.5), samples.at(99.5), offset_ns=-600_000 * MS)
    assert samples.seen(fault).zero_s == pytest.approx(0.0075, abs=CLOSE)


def test_a_sample_stamped_in_another_time_counts_when_it_arrives() -> None:
    samples = Samples()
    samples.push(0, 100, 0.5)
    samples.apart_ns += 5_000 * MS
    samples.push(130, 131, 0.0)
    found = samples.seen(Fault("step", 0, samples.at(99.9), samples.at(99.9)))
    assert found.zero_s == pytest.approx(0.0303, abs=CLOSE)


def test_a_device_that_was_away_begins_with_zero_or_not() -> None:
    samples = Samples()
    samples.push(0, 100, 0.5)
    # Half sent when it was frozen.
    samples.push(100, 101, 0.7, late_ms=850.0)
    samples.push(1000, 1003, 0.5)
    samples.push(1003, 1100, 0.0)
    samples.push(1100, 1200, 0.5)
    fault = Fault("freeze", 0, samples.at(500), samples.at(900), first_output=True)
    assert samples.seen(fault).stale == 3
    assert samples.seen(fault).zero_s == pytest.approx(0.003, abs=CLOSE)
    samples.rows = [
        row for row in samples.rows if not 900 < (row[1] - samples.begun_ns) / MS < 1003
    ]
    assert samples.seen(fault).stale == 0
    assert samples.seen(fault).zero_s == 0.0
    assert samples.seen(fault).back_s == pytest.approx(0.2002, abs=CLOSE)
    assert samples.seen(fault).peak == 0.5


def test_only_the_topics_asked_for_count() -> None:
    samples = Samples()
    samples.push(0, 100, 0.5)
    samples.push(100, 300, 0.0)
    samples.push(0, 150, 0.5, COMMAND)
    samples.push(150, 300, 0.0, COMMAND)
    fault = Fault("double", 0, samples.at(99.9), samples.at(200))
    assert samples.seen(fault).zero_s == pytest.approx(0.0001, abs=CLOSE)
    both = Fault("double", 0, samples.at(99.9), samples.at(200), topics=(DEVICE, COMMAND))
    samples.rows.sort(key=lambda row: row[1])
    assert samples.seen(both).zero_s == pytest.approx(0.0501, abs=CLOSE)


def _kept(trials: Sequence[Trial]) -> dict[str, bool]:
    found = summarised("name", trials, 0.5)
    return {figure.name.removeprefix("name: "): figure.kept for figure in found}


GOOD = Trial(0.012, 0.013, 0.5, 0.55, fault="good", said="the clock went back")


@pytest.mark.parametrize(
    ("broken", "bad"),
    [
        (ZERO_GOAL, Trial(0.0201, 0.0201, 0.5, 0.5, fault="late", said="said")),
        (ZERO_GOAL, Trial(math.inf, math.inf, math.inf, 0.5, fault="never", said="said")),
        ("rendering again after, worst", Trial(0.01, 0.01, 2.1, 0.5, fault="slow", said="said")),
        (
            "largest force, of a clean run's",
            Trial(0.01, 0.01, 0.5, 0.61, fault="strong", said="said"),
        ),
        ("said", Trial(0.01, 0.01, 0.5, 0.5, fault="silent", said="")),
        (
            "all other nodes went on",
            Trial(0.01, 0.01, 0.5, 0.5, fault="dead", said="said", alive=False),
        ),
        (
            "outputs with force before the first zero",
            Trial(0.01, 0.01, 0.5, 0.5, fault="stale", said="said", stale=1),
        ),
    ],
)
def test_one_bad_trial_among_good_ones_breaks_its_limit(broken: str, bad: Trial) -> None:
    assert all(_kept([GOOD] * 9).values())
    assert not _kept([*[GOOD] * 9, bad])[broken]
    assert "\n" not in GOOD.log(0.5)
    assert replace(bad, trace="seen").log(0.5).endswith("\nseen")


def test_a_slow_loop_is_judged_by_its_own_periods() -> None:
    late = replace(GOOD, zero_s=0.0799, pause_s=0.009)
    assert not _kept([late])[ZERO_GOAL]
    slow = replace(late, period_s=0.004)
    assert _kept([slow])[ZERO_GOAL]
    assert "\n" not in slow.log(0.5)
    assert late.paused
    assert not slow.paused
    assert not _kept([replace(slow, zero_s=0.0801)])[ZERO_GOAL]


def test_a_newcomer_counts_from_when_the_node_that_acts_heard_it() -> None:
    arrived = MS * np.arange(1000)
    on = np.ones(1000, dtype=bool)
    # The watcher met it at 500 ms, the device at 590.
    on[592:] = False
    assert first_heard(500 * MS, [590 * MS, 650 * MS], arrived, on, 0) == 590 * MS
    # What was told at 100 ms was about one that had left.
    assert first_heard(500 * MS, [100 * MS, 590 * MS], arrived, on, 0) == 590 * MS
    # Told just before the watcher met it; what is told once it has left is no first message.
    assert first_heard(500 * MS, [495 * MS, 900 * MS], arrived, on, 0) == 500 * MS
    # Nobody says that there are two: force lasts since the first message.
    assert first_heard(500 * MS, [], arrived, on, 0) == 500 * MS
    assert first_heard(500 * MS, [100 * MS], arrived, on, 0) == 500 * MS


def test_a_newcomer_that_never_speaks_counts_from_when_force_ended() -> None:
    arrived = MS * np.arange(1000)
    on = (arrived < 300 * MS) | ((arrived > 310 * MS) & (arrived < 700 * MS))
    assert first_heard(None, [698 * MS], arrived, on, 0) == 698 * MS
    # With its last message that has force: the next one is made before it arrives.
    assert first_heard(None, [], arrived, on, 0) == 699 * MS
    assert first_heard(None, [], arrived, np.zeros(1000, dtype=bool), 7) == 7


def test_a_double_could_speak_until_its_publisher_was_gone_not_until_its_process_was() -> None:
    counted = [
        {"topic": "/device/servo_cf", "count": 2, "fewer": False, "at_ns": 100 * MS},
        {"topic": "/device/state", "count": 0, "fewer": True, "at_ns": 450 * MS},
        {"topic": "/device/servo_cf", "count": 1, "fewer": True, "at_ns": 500 * MS},
    ]
    assert silent_from(counted, "/device/servo_cf", 400 * MS, 1600 * MS) == 500 * MS
    # Somebody else had gone before it was asked.
    assert silent_from(counted, "/device/servo_cf", 600 * MS, 1600 * MS) == 1600 * MS
    # One that is killed stays in the middleware's list for a while.
    assert silent_from(counted, "/device/servo_cf", 400 * MS, 450 * MS) == 450 * MS


def test_of_nodes_that_stayed_the_one_that_grew_most_counts() -> None:
    # One was restarted: another process.
    found = grown("second", {1: 0.2, 2: 0.1, 3: 0.3}, {1: 0.22, 2: 0.2, 4: 0.9})
    assert found.value == pytest.approx(2.0)
    assert found.trials == 2
    assert not found.kept
    assert grown("second", {1: 0.2}, {1: 0.25}).kept
    # Nobody stayed: nothing is known.
    assert not grown("second", {1: 0.2}, {4: 0.2}).kept
