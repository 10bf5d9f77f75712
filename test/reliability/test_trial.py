# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What is read from the watcher's samples: each fault that a device can have is seen."""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

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

    def __init__(self, *pushes: tuple[float, ...] | dict[str, float]) -> None:
        self.begun_ns = time.monotonic_ns() - 10_000 * MS
        self.rows: list[tuple[int, int, int, int, float, float]] = []
        for push in pushes:
            self.push(**push) if isinstance(push, dict) else self.push(*push)

    def at(self, ms: float) -> int:
        return self.begun_ns + round(ms * MS)

    def push(
        self,
        begin_ms: int,
        end_ms: int,
        force: float,
        topic: int = DEVICE,
        late_ms: float = 0.2,
        torque: float = 0.0,
        ahead_ms: int = 0,
    ) -> None:
        """Add samples of a force, N; their clock may be ahead of the watcher's."""
        for ms in range(begin_ms, end_ms):
            stamp = self.at(ms) + wall_ahead_ns() + ahead_ms * MS
            self.rows.append((topic, self.at(ms + late_ms), stamp, ms, force, torque))

    def seen(self, name: str, begin_ms: float, end_ms: float, **kinds: Any) -> Seen:
        """Return what is seen of a fault between these times."""
        fault = Fault(name, 0, self.at(begin_ms), self.at(end_ms), **kinds)
        rows = sorted((row for row in self.rows if row[0] in fault.topics), key=lambda row: row[1])
        return seen(np.array(rows, SAMPLE), fault)


def push(begin_ms: int, end_ms: int, force: float, **more: Any) -> dict[str, Any]:
    return {"begin_ms": begin_ms, "end_ms": end_ms, "force": force, **more}


HELD, KILLED = (0, 100, 0.5), ("kill", 99.9, 300)
MINUTES = 600_000
ASKED = [HELD, (100, 300, 0.0), (0, 150, 0.5, COMMAND), (150, 300, 0.0, COMMAND)]
AWAY = [(1003, 1100, 0.0), (1100, 1200, 0.5)]
# Samples, a fault and what else is known of it, and what is seen.
SEEN: dict[str, tuple[list[Any], tuple[Any, ...], dict[str, Any], dict[str, Any]]] = {
    "lets go and comes back": (
        [(0, 112, 0.5), (112, 400, 0.0), (400, 500, 0.5)],
        *(KILLED, {}, {"zero_s": 0.0121, "heard_s": 0.0123, "back_s": 0.1}),
    ),
    "force that returns while the fault lasts is no zero": (
        [(0, 112, 0.5), (112, 200, 0.0), (200, 201, 0.1), (201, 400, 0.0)],
        *(("double", 99.9, 300), {}, {"zero_s": 0.1011}),
    ),
    "a torque alone is a push": (
        [HELD, push(150, 151, 0.0, torque=0.1), (151, 152, 0.0)],
        *(KILLED, {}, {"zero_s": 0.0511}),
    ),
    "a force that is no number is a push": (
        [HELD, (150, 151, math.nan), (151, 152, 0.0)],
        *(KILLED, {}, {"zero_s": 0.0511}),
    ),
    "a torque that is no number is a push": (
        [HELD, push(150, 151, 0.0, torque=math.nan), (151, 152, 0.0)],
        *(KILLED, {}, {"zero_s": 0.0511}),
    ),
    "never lets go": (
        *([(0, 500, 0.5)], ("step", 99.9, 99.9), {}),
        {"zero_s": math.inf, "came_back": False},
    ),
    "silent": ([], ("step", 99.9, 99.9), {}, {"zero_s": math.inf}),
    "stamps of a stepped clock tell the same": (
        [
            *(HELD, push(100, 107, 0.5, ahead_ms=-MINUTES)),
            *(push(107, 200, 0.0, ahead_ms=-MINUTES), push(200, 300, 0.5, ahead_ms=-MINUTES)),
        ],
        *(("step", 99.5, 99.5), {"offset_ns": -MINUTES * MS}, {"zero_s": 0.0075}),
    ),
    "a sample stamped in another time counts when it arrives": (
        [HELD, push(130, 131, 0.0, ahead_ms=5_000)],
        *(("step", 99.9, 99.9), {}, {"zero_s": 0.0303}),
    ),
    # One is half sent when it is frozen.
    "was away, and begins with force": (
        [HELD, push(100, 101, 0.7, late_ms=850.0), (1000, 1003, 0.5), *AWAY],
        *(("freeze", 500, 900), {"first_output": True}, {"stale": 3, "zero_s": 0.003}),
    ),
    "was away, and begins with zero": (
        *([HELD, *AWAY], ("freeze", 500, 900), {"first_output": True}),
        {"stale": 0, "zero_s": 0.0, "back_s": 0.2002, "peak": 0.5},
    ),
    "an output on its way when the fault began is none of it": (
        [HELD, push(99, 100, 0.9, late_ms=5.0), (100, 112, 0.5), (112, 200, 0.0)],
        *(KILLED, {}, {"peak": 0.5}),
    ),
    "what was on its way until after it let go is no return": (
        [HELD, push(450, 451, 0.7, late_ms=600.0), *AWAY],
        *(("freeze", 500, 900), {"first_output": True}, {"back_s": 0.2002}),
    ),
    "a push before it let go is no return": (
        [(0, 107, 0.5), (107, 200, 0.0), (200, 300, 0.5)],
        *(("step", 99.9, 99.9), {}, {"zero_s": 0.0071, "back_s": 0.1001}),
    ),
    "a force that is no number is the largest": (
        *([HELD, (100, 101, math.nan), (101, 152, 0.0)], KILLED, {}),
        {"peak": math.inf},
    ),
    "a step of the device's clock is no pause": (
        [HELD, push(100, 150, 0.8, ahead_ms=MINUTES)],
        *(("step", 49.9, 49.9), {}, {"peak": 0.8, "pause_s": 0.0}),
    ),
    "one topic counts": (ASKED, ("double", 99.9, 200), {}, {"zero_s": 0.0001}),
    "both topics count": (
        *(ASKED, ("double", 99.9, 200), {"topics": (DEVICE, COMMAND)}, {"zero_s": 0.0501}),
    ),
}


@pytest.mark.parametrize(("pushes", "fault", "kinds", "expected"), SEEN.values(), ids=SEEN)
def test_what_a_device_does_is_seen(
    pushes: list[Any], fault: tuple[Any, ...], kinds: dict[str, Any], expected: dict[str, Any]
) -> None:
    found = Samples(*pushes).seen(*fault, **kinds)
    assert {name: getattr(found, name) for name in expected} == pytest.approx(expected, abs=CLOSE)


@pytest.mark.parametrize(
    ("pause_ms", "before_ms", "paused"), [(1, 0, False), (2, 5, False), (3, 5, True), (8, 0, True)]
)
def test_force_after_a_pause_of_the_devices_process_is_told_apart(
    pause_ms: int, before_ms: int, paused: bool
) -> None:
    peak = 650 + pause_ms + before_ms
    found = Samples(
        *((0, 112, 0.5), (112, 400, 0.0), (400, 650, 0.5), (649 + pause_ms, peak, 0.5)),
        *((peak, peak + 10, 0.8), (peak + 10, 900, 0.5)),
    ).seen(*KILLED)
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


ARRIVED = MS * np.arange(1000)
# The device met it at 590 ms.
UNTIL_592 = np.arange(1000) < 592
TWICE = (ARRIVED < 300 * MS) | ((ARRIVED > 310 * MS) & (ARRIVED < 700 * MS))
NEVER = np.zeros(1000, dtype=bool)


@pytest.mark.parametrize(
    ("met", "told", "on", "expected"),
    [
        (500, [590, 650], UNTIL_592, 590 * MS),
        # What was told at 100 ms was about one that had left.
        (500, [100, 590], UNTIL_592, 590 * MS),
        # Told just before the watcher met it; what is told once it has left is no first message.
        (500, [495, 900], UNTIL_592, 500 * MS),
        # Nobody says that there are two: force lasts since the first message.
        (500, [], UNTIL_592, 500 * MS),
        (500, [100], UNTIL_592, 500 * MS),
        # One that never speaks counts from when force ended.
        (None, [698], TWICE, 698 * MS),
        # With its last message that has force: the next one is made before it arrives.
        (None, [], TWICE, 699 * MS),
        (None, [], NEVER, 7),
    ],
)
def test_a_newcomer_counts_from_when_the_node_that_acts_heard_it(
    met: int | None, told: list[int], on: Any, expected: int
) -> None:
    met_ns = None if met is None else met * MS
    assert first_heard(met_ns, [ms * MS for ms in told], ARRIVED, on, 7) == expected


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
