# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Whether a graph fits its machine: what its nodes report of processor time and of deadlines."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from hapticmech_ros.readiness import Report

# Known after so long, s; from then on the last reports count against the first ones.
LEAST_SPAN_S = 0.9
# A node's reports count from so long after its first one on, s: until then the middleware carries
# its messages as well, and what handles them without Python does not.
SETTLES_S = 1.0
# A graph fits if it misses no larger share of its deadlines, and takes no more of the processors:
# other programs were there after 0.7 s beside one that takes a third of two, and 1.1 s beside 0.6.
MOST_MISSED, MOST_USED = 0.03, 0.5
# One that takes more of them than this and misses more keeps no deadlines, whatever it takes away
# from others.
TAKES_ALL, MISSES_MANY = 0.8, 0.1
# What is proposed would take no more than this: there are moments that are busier than a second's
# mean.
PROPOSED_USED = 0.4
# The control rates that are proposed, Hz.
RATES = (1000.0, 500.0, 250.0)


@dataclass(frozen=True, slots=True)
class GraphLoad:
    """What a graph costs, over a span of time.

    Attributes:
        rate_hz: control rate that is wanted.
        cores: processors that there are for it.
        used: processors' worth of time that its processes took.
        missed: largest share of deadlines that a node missed.
        composed: whether its nodes share a process.
        users: how many hands there are.
    """

    rate_hz: float
    cores: float
    used: float
    missed: float
    composed: bool = False
    users: int = 1

    @property
    def period_us(self) -> float:
        """Processor time of all nodes per control period that was kept, us."""
        return 1e6 * self.used / (self.rate_hz * max(1.0 - self.missed, 0.1))

    @property
    def fits(self) -> bool:
        """Whether deadlines are kept, and something is left to other programs."""
        return self.missed <= MOST_MISSED and self.used <= MOST_USED * self.cores

    @property
    def saturates(self) -> bool:
        """Whether it takes the machine from all others and misses deadlines all the same."""
        return self.missed > MISSES_MANY and self.used > TAKES_ALL * self.cores

    @property
    def fitting_rate_hz(self) -> float | None:
        """The highest of :data:`RATES` below the present one that would fit; None: none would.

        If none fits by what a period costs, the lowest is proposed: something else may take the
        processors away.
        """
        lower = [rate for rate in RATES if rate < 0.99 * self.rate_hz]
        for rate in lower:
            if 1e-6 * self.period_us * rate <= PROPOSED_USED * self.cores:
                return rate
        return lower[-1] if lower else None

    def sentence(self) -> str:
        """Return what a period costs, in a line."""
        cost = f"{self.period_us:.0f} us of processor time"
        share = f"{self.used:.2f} of {self.cores:g} cores"
        missed = f"{self.missed:.1%} of the deadlines missed"
        return f"a period of {1e3 / self.rate_hz:g} ms takes {cost}: {share}, {missed}"

    def sentences(self) -> list[str]:
        """Return what to tell people: what a period costs, and what helps if that is too much."""
        return [self.sentence(), *([] if self.fits else [self.advice()])]

    def advice(self) -> str:
        """Return what helps if it does not fit, in a line."""
        rate = self.fitting_rate_hz
        helps = [f"--control-rate {rate:g}"] if rate is not None else []
        helps += [] if self.composed else ["--composed"]
        helps += ["fewer users"] if self.users > 1 else []
        helps.append("ending other programs")
        carried = self.missed <= MOST_MISSED
        why = "leaves too little to other programs at" if carried else "does not carry"
        return (
            f"this machine {why} {self.rate_hz:g} Hz: the loop may be interrupted; "
            f"what helps: {', '.join(helps)} (docs/realtime.md)"
        )


class LoadWatch:
    """Finds a graph's load from the reports of its nodes, once it has settled.

    Args:
        rate_hz: control rate.
        cores: processors that there are for it.
        composed: whether its nodes share a process.
        users: how many hands there are.
        least_span_s: s between the reports that are compared.
        settles_s: s after a node's first report, from when on its reports count.
    """

    def __init__(
        self,
        rate_hz: float,
        cores: float,
        composed: bool = False,
        users: int = 1,
        least_span_s: float = LEAST_SPAN_S,
        settles_s: float = SETTLES_S,
    ) -> None:
        self._rate_hz, self._cores = rate_hz, cores
        self._composed, self._users = composed, users
        self._least_span_s, self._settles_s = least_span_s, settles_s
        self._first: dict[str, Mapping[str, str]] = {}
        # When each process reported first, s of its clock.
        self._begun: dict[tuple[str, str], float] = {}

    def look(self, reports: Mapping[str, Report]) -> GraphLoad | None:
        """Take what nodes have reported last; return the load since the first of their reports.

        None until all that have reported once have reported again, the least span later.
        """
        used: dict[str, float] = {}
        missed = 0.0
        for name, report in reports.items():
            now = report.figures
            if "pid" not in now:
                # Not configured yet.
                return None
            time_s, then = float(now["monotonic_s"]), self._first.setdefault(name, now)
            begun = self._begun.setdefault((name, now["pid"]), time_s)
            if now["pid"] != then["pid"] or float(then["monotonic_s"]) < begun + self._settles_s:
                then = self._first[name] = now
            span = time_s - float(then["monotonic_s"])
            if span < self._least_span_s:
                continue
            # Of a process with several nodes, that of any of them.
            used[name] = (float(now["cpu_s"]) - float(then["cpu_s"])) / span
            periods = int(now.get("periods", 0)) - int(then.get("periods", 0))
            if periods > 0:
                lost = int(now["missed_deadlines"]) - int(then["missed_deadlines"])
                missed = max(missed, lost / periods)
        if not used or len(used) < len(reports):
            return None
        by_process = {reports[name].figures["pid"]: share for name, share in used.items()}
        total = sum(by_process.values())
        return GraphLoad(self._rate_hz, self._cores, total, missed, self._composed, self._users)
