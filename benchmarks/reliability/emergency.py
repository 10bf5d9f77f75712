# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""An emergency stop, after a clock was stepped or beside busy programs: zero, then its answer.

Part ``emergency``: stops alone and beside two programs that compute without end.
"""

from __future__ import annotations

import math
import os
import time
from collections.abc import Callable, Sequence
from contextlib import closing, suppress
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from benchmarks.children import BenchError, busy_programs
from benchmarks.reliability.caller import Answer, Caller
from benchmarks.reliability.figure import Figure, figures_of
from benchmarks.reliability.rig import MS, Rig, pushing
from hapticmech_ros.nodes.realtime import NICE

# The answer and the sample take ways of their own to processes of their own.
WAYS_MS = 5.0
STOPPED_S = 0.3
CALLS, QUICK_CALLS, BUSY, ANSWERED_MS = 100, 5, 2, 10.0


@dataclass(frozen=True, slots=True)
class Stop:
    """What followed a call.

    Attributes:
        fault: what came before, in words.
        success: what it answered; False if it did not.
        answered_ms: from the call to its answer.
        zero_ms: from its answer to the first output at zero: none after that pushes.
    """

    fault: str
    success: bool
    answered_ms: float
    zero_ms: float


def run(quick: bool, out: Path) -> list[Figure]:
    """Stop a device that renders 100 times (quick: 5), alone and beside two busy programs.

    The caller runs before, and has the nodes' nice value: an ordinary one sees the answer later.
    The busy programs come first, since programs begun later would have it too.
    """
    number, found = QUICK_CALLS if quick else CALLS, list[Figure]()
    with Rig(out, "emergency") as rig:
        for busy in (BUSY, 0):
            with busy_programs(busy):
                os.setpriority(os.PRIO_PROCESS, 0, NICE)
                with closing(Caller(rig.environment)) as caller:
                    stops = [
                        try_stop(rig, caller, "no fault", time.monotonic_ns) for _ in range(number)
                    ]
            found += summarised_stops(f"stop beside {busy} busy programs", stops, ANSWERED_MS)
    return found


def try_stop(
    rig: Rig, caller: Caller, words: str, fault: Callable[[], int], at_once: bool = True
) -> Stop:
    """Stop after a fault, at once or once the device renders again, and let it go on.

    Args:
        rig: of the graph.
        caller: calls the stop; it releases one first, since a first call takes longer.
        words: that describe the fault.
        fault: does it, and returns when, ns of the monotonic clock.
        at_once: whether to stop before the device renders again.
    """
    caller.stop(False)
    since = rig.ready()
    stepped_ns = fault()
    try:
        if not at_once:
            since = rig.settle(stepped_ns)
        answer = caller.stop(True)
    except BenchError:
        answer = Answer(False, stepped_ns, time.monotonic_ns())
    time.sleep(STOPPED_S)
    found = rig.samples(since)
    found = found[found["arrived_ns"] >= stepped_ns]
    on, arrived = pushing(found), found["arrived_ns"]
    after = arrived[~on & (arrived >= arrived[on].max(initial=stepped_ns))]
    zero_ms = float(after[0] - answer.answered_ns) / MS if after.size else math.inf
    with suppress(BenchError):
        caller.stop(False)
    rig.ready()
    took_ms = (answer.answered_ns - answer.called_ns) / MS
    return Stop(words, answer.success, took_ms, zero_ms)


def summarised_stops(
    where: str, stops: Sequence[Stop], most_ms: float | None = None
) -> list[Figure]:
    """Return the worst of some calls as figures; they are to answer within a time, ms."""
    figure, well = figures_of(where, len(stops)), [stop.success for stop in stops]
    took = [stop.answered_ms for stop in stops]
    return [
        figure("answered success", 100.0 * sum(well) / len(well), "%", least=100.0),
        figure("answered after, median", float(np.median(took)), "ms"),
        figure("answered after, worst", max(took), "ms", most=most_ms),
        figure(
            "zero after its answer",
            max(stop.zero_ms for stop in stops),
            "ms",
            most=WAYS_MS,
            note="the answer and the output reach two processes",
        ),
    ]
