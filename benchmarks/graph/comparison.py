# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The real graph beside the bare one, configuration by configuration, and the graph's goals."""

from __future__ import annotations

import statistics
from collections import defaultdict
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

from benchmarks.goals import Verdict, at_most, unknown, verdict
from benchmarks.graph.checks import Check, check_sizes
from benchmarks.graph.plan import KINDS, Configuration
from benchmarks.graph.recorded import ANSWERED, ASKED, LOST, RECORDED_TRIP, UNSEEN
from benchmarks.graph.run import STOLEN, Run, processor_share
from benchmarks.graph.statuses import DROPPED, MISSED, RATE, ROUND_TRIP, Figures, latency
from hapticmech_ros.analysis.study import NOTHING, Sheet, judged
from hapticmech_ros.wire.topics import DEVICE

# Of the rate wanted; 1000 ± 1 Hz.
RATE_TOLERANCE = 1e-3
MISSED_LIMIT, CPU_LIMIT = 0.5, 70.0
RATIO_LIMITS = {"p50": 0.4, "p99": 0.6}
SEPARATE_HZ, COMPOSED_HZ = 1000.0, 2000.0
# What is not a median over the runs: counts are added up, and the worst run counts.
OVER_RUNS: dict[str, Callable[[Sequence[float]], float]] = {
    **dict.fromkeys((ASKED, LOST, UNSEEN, DROPPED), sum),
    RATE: min,
    MISSED: statistics.mean,
    STOLEN: max,
}


@dataclass(frozen=True, slots=True)
class Side:
    """One graph in a configuration.

    Attributes:
        runs: all of them.
        failures: why runs gave no figures, and checks that did not hold.
        figures: over the runs that gave some.
    """

    runs: tuple[Run, ...]
    failures: tuple[str, ...]
    figures: Figures


@dataclass(frozen=True, slots=True)
class Comparison:
    """Both graphs in one configuration.

    Attributes:
        configuration: of both.
        real, bare: each.
        alike: whether both had the same messages; None without a recorder.
    """

    configuration: Configuration
    real: Side
    bare: Side
    alike: Check | None

    def ratio(self, name: str) -> float | None:
        """Return a figure of the real graph over the bare one's; None if one of them has none."""
        real, bare = (side.figures.get(name) for side in (self.real, self.bare))
        return None if real is None or not bare else real / bare

    def sheet(self) -> Sheet:
        """Return all figures, and what failed."""
        sides = (self.real, self.bare)
        rows: list[tuple[str, ...]] = [
            (
                "runs that passed all checks",
                *(f"{sum(run.sound for run in side.runs)} of {len(side.runs)}" for side in sides),
            )
        ]
        for name in {**self.real.figures, **self.bare.figures}:
            cells = [_cell(side.figures.get(name)) for side in sides]
            ratio = self.ratio(name)
            rows.append((name, *cells, "" if ratio is None else f"{ratio:.2f}"))
        if self.alike is not None:
            rows.append(("same topics and sizes", judged(self.alike.seen, self.alike.held)))
        rows += [("check failed", judged(failure, False)) for failure in self.real.failures]
        rows += [("check failed", "", judged(failure, False)) for failure in self.bare.failures]
        return Sheet(
            str(self.configuration),
            ("", "real", "bare", "real / bare"),
            tuple(rows),
            ("real", "bare"),
        )


def _cell(value: float | None) -> str:
    return NOTHING if value is None else f"{value:.4g}" if value < 1e4 else f"{value:.0f}"


def compare(configuration: Configuration, runs: Sequence[Run], point: str) -> Comparison:
    """Return the comparison of a configuration's runs.

    Args:
        configuration: which runs to take.
        runs: of any configuration.
        point: operational point that is held.
    """
    mine = [run for run in runs if run.step.configuration == configuration]
    real, bare = ([run for run in mine if run.step.kind == kind] for kind in KINDS)
    bags = [[run.sizes for run in side if run.sizes] for side in (real, bare)]
    alike = check_sizes(bags[0][0], bags[1][0], point) if all(bags) else None
    return Comparison(configuration, _side(real), _side(bare), alike)


def _side(runs: Sequence[Run]) -> Side:
    broken = tuple(f"run {run.step.repeat}: {why}" for run in runs for why in run.faults)
    found: dict[str, list[float]] = defaultdict(list)
    for run in runs:
        for name, value in run.figures.items():
            found[name].append(value)
    over_runs = {name: OVER_RUNS.get(name.rpartition(": ")[2], statistics.median) for name in found}
    figures = {name: float(over_runs[name](values)) for name, values in found.items()}
    return Side(tuple(runs), broken, figures)


def verdicts(comparisons: Sequence[Comparison]) -> tuple[Verdict, ...]:
    """Return a verdict for each goal; one that no run is about is ``not measured``."""
    # As shipped: other transports and settings are for comparison.
    known = {one.configuration: one for one in comparisons}
    recorded = Configuration(SEPARATE_HZ, "separate", True)
    separate = known.get(recorded) or compare(recorded, (), "")
    # What a recorder needs besides is its own; with it if it was never left out.
    alone, beside = (Configuration(COMPOSED_HZ, "composed", one) for one in (False, True))
    composed = known.get(alone) or known.get(beside) or compare(alone, (), "")
    share = composed.real.figures.get(processor_share("composed"))
    busy = f"{composed.configuration}: at most {CPU_LIMIT:g} % of one core"
    return (
        _sound(separate),
        _lost(separate),
        *_kept(separate),
        *_latencies(separate),
        _sound(composed),
        *_kept(composed),
        at_most(busy, share, CPU_LIMIT, "{:.1f} %"),
    )


def _sound(found: Comparison) -> Verdict:
    goal = f"{found.configuration}: every run passes its checks"
    if not found.real.runs:
        return unknown(goal)
    broken = [*found.real.failures, *(f"bare, {reason}" for reason in found.bare.failures)]
    if found.alike is not None and not found.alike.held:
        broken.append(found.alike.seen)
    return verdict(goal, broken[0] if broken else "all", not broken)


def _lost(found: Comparison) -> Verdict:
    goal = f"{found.configuration}: no control message lost"
    lost, asked, unseen = (
        sum(found.real.figures.get(f"{name}: {what}", 0.0) for name in ANSWERED)
        for what in (LOST, ASKED, UNSEEN)
    )
    if not asked:
        return unknown(goal)
    beside = f"; the recorder itself lost {unseen:.0f}" if unseen else ""
    return verdict(goal, f"{lost:.0f} of {asked:.0f} lost{beside}", lost == 0)


def _kept(found: Comparison) -> list[Verdict]:
    where, rate_hz, name = found.configuration, found.configuration.rate_hz, f"{DEVICE}: {RATE}"
    tolerance = RATE_TOLERANCE * rate_hz
    rates = [run.figures[name] for run in found.real.runs if name in run.figures]
    worst = max(rates, key=lambda rate: abs(rate - rate_hz), default=None)
    goal = f"{where}: device at {rate_hz:g} ± {tolerance:g} Hz in every run"
    rarely = f"{where}: at most {MISSED_LIMIT:g} % of the device's deadlines missed"
    missed = found.real.figures.get(f"{DEVICE}: {MISSED}")
    return [
        unknown(goal)
        if worst is None
        else verdict(goal, f"{worst:.2f} Hz", abs(worst - rate_hz) <= tolerance),
        at_most(rarely, missed, MISSED_LIMIT, "{:.3f} %"),
    ]


def _latencies(found: Comparison) -> Iterator[Verdict]:
    for share, limit in RATIO_LIMITS.items():
        goal = f"{found.configuration}: {share} of {ROUND_TRIP} at most {limit:g} x bare"
        ratio, beside = (found.ratio(latency(hop, share)) for hop in (ROUND_TRIP, RECORDED_TRIP))
        recorded = "" if beside is None else f"; {RECORDED_TRIP} at the recorder {beside:.2f} x"
        yield at_most(goal, ratio, limit, f"{{:.2f}} x{recorded}")
