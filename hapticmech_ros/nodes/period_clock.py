# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Absolute deadlines of a periodic node: next = previous + period, never "now + period"."""

from __future__ import annotations

from dataclasses import dataclass

from hapticmech_ros.times import nanoseconds


@dataclass(slots=True)
class PeriodClock:
    """Counts periods on a fixed grid of time; the caller says what time it is.

    Attributes:
        period_ns: length of a period, ns.
        next_ns: start of the next period that is not yet due.
        periods: periods begun so far.
        missed: periods that had gone by when their turn came (deadlines missed).
    """

    period_ns: int
    next_ns: int
    periods: int = 0
    missed: int = 0

    @classmethod
    def on_grid(cls, period_s: float, phase: float, now_ns: int) -> PeriodClock:
        """Return a clock whose deadlines are whole periods plus ``phase`` (a share of a period).

        Nodes with the same period share the grid, and their phases say who goes first.
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

    Paying all at once would make the next tick late in turn; a debt beyond ``limit`` is forgotten,
    and counted, so that an overloaded machine runs slow instead of standing still.
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
