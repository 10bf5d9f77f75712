# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A node's time by the machine's clock: ROS time for stamps that never goes back by itself.

Deadlines, freshness and timeouts must not follow a clock that may be set. So the time of a node is
the monotonic clock plus a constant, which makes it ROS time. NTP slews both clocks alike, and the
constant stays right; when the machine's clock is *set*, or the machine has slept, it is wrong from
then on. That is an event: the constant is measured anew, and the node begins anew.

Deadlines are absolute: next = previous + period, never "now + period".

Counts and percentiles that cost next to nothing per message: a histogram of durations.
"""

from __future__ import annotations

import os
import time
from array import array
from dataclasses import dataclass

import numpy as np

from hapticmech_ros.numerics import Array
from hapticmech_ros.numerics.times import NANOSECONDS, nanoseconds

BIN_NS = 10_000
BINS = 20_000


class DurationHistogram:
    """Durations in bins of 10 µs up to 200 ms; longer ones are in the last bin."""

    def __init__(self) -> None:
        self._counts = array("q", bytes(8 * BINS))
        self.count = 0
        self.max_ns = 0

    def add(self, duration_ns: int) -> None:
        """Count one duration; negative ones count as zero."""
        index = min(max(duration_ns, 0) // BIN_NS, BINS - 1)
        self._counts[index] += 1
        self.count += 1
        self.max_ns = max(self.max_ns, duration_ns)

    def extend(self, durations_ns: Array) -> None:
        """Count durations.

        Args:
            durations_ns: (n,) ns.
        """
        if not durations_ns.size:
            return
        bins = np.clip(durations_ns, 0, None) // BIN_NS
        np.add.at(np.frombuffer(self._counts, dtype=np.int64), np.minimum(bins, BINS - 1), 1)
        self.count += durations_ns.size
        self.max_ns = max(self.max_ns, int(durations_ns.max()))

    def percentiles_us(self, *shares: float) -> tuple[float, ...]:
        """Return percentiles (0 to 100) in µs, upper edge of the bin; 0 if nothing was counted."""
        if self.count == 0:
            return (0.0,) * len(shares)
        totals = np.cumsum(np.frombuffer(self._counts, dtype=np.int64))
        needed = [np.ceil(share / 100.0 * self.count) for share in shares]
        indices = [int(np.searchsorted(totals, max(need, 1.0))) for need in needed]
        return tuple((index + 1) * BIN_NS / 1000.0 for index in indices)

    def summary(self, name: str) -> dict[str, str]:
        """Return the figures for diagnostics, keys ``<name>_p50_us`` and so on."""
        p50, p90, p99 = self.percentiles_us(50.0, 90.0, 99.0)
        return {
            f"{name}_count": str(self.count),
            f"{name}_p50_us": f"{p50:.0f}",
            f"{name}_p90_us": f"{p90:.0f}",
            f"{name}_p99_us": f"{p99:.0f}",
            f"{name}_max_us": f"{self.max_ns / 1000.0:.0f}",
        }


def processor_time() -> dict[str, str]:
    """Return this process's number and processor time until now, for diagnostics.

    Returns:
        Its number, its processor time, s, and the time of the machine's monotonic clock, s.
    """
    return {
        "pid": str(os.getpid()),
        "cpu_s": f"{time.process_time():.4f}",
        "monotonic_s": f"{time.monotonic():.4f}",
    }


# A smaller step changes nothing that is felt: poses are carried on over no more than this.
STEP_NS = 5_000_000
# Reads of both clocks: the closest pair counts, as a process may be interrupted between two.
_READS = 5


class NodeTime:
    """ROS time that advances evenly, and detects when the machine's clock was set."""

    def __init__(self) -> None:
        self._ahead_ns = wall_ahead_ns()

    def now_ns(self) -> int:
        """Return the time, ns since the epoch."""
        return time.monotonic_ns() + self._ahead_ns

    def step_ns(self) -> int:
        """Return by how much the machine's clock was set since it was asked last, ns; else 0.

        From then on time follows the clock as it was set.
        """
        apart = time.time_ns() - time.monotonic_ns() - self._ahead_ns
        if -STEP_NS <= apart <= STEP_NS:
            return 0
        ahead = wall_ahead_ns()
        apart = ahead - self._ahead_ns
        if -STEP_NS <= apart <= STEP_NS:
            # Interrupted between the two reads.
            return 0
        self._ahead_ns = ahead
        return apart


def clock_step_text(step_ns: int) -> str:
    """Return a sentence on a step of a clock, ns."""
    way = "forward" if step_ns > 0 else "back"
    return f"clock set {way} by {abs(step_ns) / NANOSECONDS:.3g} s"


def wall_ahead_ns() -> int:
    """Return how far the machine's clock is ahead of the monotonic one, ns."""
    best, narrowest = 0, 1 << 62
    for _ in range(_READS):
        before = time.monotonic_ns()
        wall = time.time_ns()
        width = time.monotonic_ns() - before
        if width < narrowest:
            narrowest, best = width, wall - before - width // 2
    return best


@dataclass(slots=True)
class PeriodClock:
    """Counts periods on a fixed grid of time; the caller passes the time.

    Attributes:
        period_ns: length of a period, ns.
        next_ns: start of the next period that is not yet due.
        periods: periods begun so far.
        missed: periods that had passed when their turn came (deadlines missed).
    """

    period_ns: int
    next_ns: int
    periods: int = 0
    missed: int = 0

    @classmethod
    def on_grid(cls, period_s: float, phase: float, now_ns: int) -> PeriodClock:
        """Return a clock whose deadlines are whole periods plus ``phase`` (a share of a period).

        Nodes with the same period share the grid, and their phases give the order.
        """
        period_ns = nanoseconds(period_s)
        offset = round(phase * period_ns) % period_ns
        first = (now_ns // period_ns + 1) * period_ns + offset
        return cls(period_ns, first)

    def due(self, now_ns: int) -> int:
        """Return how many periods are due, and count them; 0 while the deadline lies ahead.

        Periods beyond the first are missed deadlines: they are skipped as a whole, and the grid
        stays where it is.
        """
        if now_ns < self.next_ns:
            return 0
        count = (now_ns - self.next_ns) // self.period_ns + 1
        self.next_ns += count * self.period_ns
        self.periods += count
        self.missed += count - 1
        return count

    @property
    def last_deadline_ns(self) -> int:
        """Deadline of the period that was last due."""
        return self.next_ns - self.period_ns


@dataclass(slots=True)
class Backlog:
    """Steps that a simulation owes to the clock after a stall, paid back a few per tick.

    Paying all at once would make the next tick late in turn; a debt beyond ``limit`` is dropped and
    counted: an overloaded machine then runs slow instead of standing still.
    """

    per_tick: int = 8
    limit: int = 500
    owed: int = 0
    dropped: int = 0

    def steps(self, periods: int) -> int:
        """Take on ``periods`` and return how many steps to do in this tick."""
        self.owed += periods
        if self.owed > self.limit:
            self.dropped += self.owed - self.limit
            self.owed = self.limit
        steps = min(self.owed, self.per_tick)
        self.owed -= steps
        return steps
