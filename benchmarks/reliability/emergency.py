# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""An emergency stop after a clock was stepped: zero has left before it answers."""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from contextlib import closing, suppress
from dataclasses import dataclass

from benchmarks.children import BenchError
from benchmarks.reliability.caller import Caller
from benchmarks.reliability.figure import Figure, figures_of
from benchmarks.reliability.rig import MS, Rig, pushing
from benchmarks.reliability.stepped_clock import SteppedClock

# The answer and the sample take ways of their own to processes of their own.
WAYS_MS = 5.0
STOPPED_S = 0.3


@dataclass(frozen=True, slots=True)
class Stop:
    """What followed a call.

    Attributes:
        fault: what came before, in words.
        success: what it answered; False if it did not.
        zero_ms: from its answer to the first output at zero: none after that pushes.
    """

    fault: str
    success: bool
    zero_ms: float

    @property
    def line(self) -> str:
        """All of it for a log."""
        answered = "success" if self.success else "NO SUCCESS"
        return f"emergency stop, {self.fault}: {answered}, zero {self.zero_ms:+.1f} ms after it"


def try_stop(rig: Rig, clock: SteppedClock, seconds: float, at_once: bool) -> Stop:
    """Step the clock, stop at once or once the device renders again, and let it go on."""
    since = rig.ready()
    with closing(Caller(rig.environment)) as caller:
        caller.stop(False)
        stepped_ns = clock.step(seconds)
        try:
            if not at_once:
                since = rig.settle(stepped_ns)
            success, answered_ns = caller.stop(True)
        except BenchError:
            success, answered_ns = False, time.monotonic_ns()
        time.sleep(STOPPED_S)
        found = rig.samples(since)
        found = found[found["arrived_ns"] >= stepped_ns]
        on, arrived = pushing(found), found["arrived_ns"]
        after = arrived[~on & (arrived >= arrived[on].max(initial=stepped_ns))]
        zero_ms = float(after[0] - answered_ns) / MS if after.size else math.inf
        with suppress(BenchError):
            caller.stop(False)
        rig.ready()
    when = "at once" if at_once else "once it renders again"
    return Stop(f"clock {seconds:+g} s, {when}", success, zero_ms)


def summarised_stops(stops: Sequence[Stop]) -> list[Figure]:
    """Return the worst of some calls as figures."""
    figure = figures_of("emergency stop after a step", len(stops))
    share = 100.0 * sum(stop.success for stop in stops) / len(stops) if stops else math.nan
    worst = max((stop.zero_ms for stop in stops), default=math.nan)
    note = "the answer and the output reach two processes"
    return [
        figure("answered success", share, "%", least=100.0),
        figure("zero after its answer", worst, "ms", most=WAYS_MS, note=note),
    ]
