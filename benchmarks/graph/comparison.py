# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The real graph beside the bare one, configuration by configuration."""

from __future__ import annotations

import statistics
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from benchmarks.graph.checks import Check, check_sizes
from benchmarks.graph.plan import KINDS, Configuration
from benchmarks.graph.recorded import Losses, total
from benchmarks.graph.run import Run
from benchmarks.graph.statuses import Percentiles, median_of, ratios


@dataclass(frozen=True, slots=True)
class Latency:
    """A hop in both graphs: medians over the runs of each percentile, and real to bare.

    Attributes:
        hop: from where to where.
        by: who measured: ``nodes``, or the ``recorder``.
        real, bare: None where no run has it.
        ratio: by percentile, ``p50`` and so on.
    """

    hop: str
    by: str
    real: Percentiles | None
    bare: Percentiles | None
    ratio: Mapping[str, float]


@dataclass(frozen=True, slots=True)
class Kept:
    """How a clocked node kept its deadlines over all runs.

    Attributes:
        worst_hz: rate of the run that was furthest from the rate wanted.
        missed_share: missed of all periods, all runs together.
        dropped: periods never simulated, all runs together.
    """

    worst_hz: float
    missed_share: float
    dropped: int


@dataclass(frozen=True, slots=True)
class Side:
    """One graph, over its runs in a configuration.

    Attributes:
        runs: number of runs that gave figures; ``sound`` of them passed every check.
        failures: why runs gave none, and checks that did not hold.
        kept: by clocked node.
        answered_share: answers to samples, by node, median over the runs; to a sample or two.
        losses: by loss, all runs together; empty without a recorder.
        cpu: share of one core by process, median over the runs.
        stolen: largest share of the machine that the host gave to others.
    """

    runs: int
    sound: int
    failures: tuple[str, ...]
    kept: Mapping[str, Kept]
    answered_share: Mapping[str, float]
    losses: Mapping[str, Losses]
    cpu: Mapping[str, float]
    stolen: float


@dataclass(frozen=True, slots=True)
class Comparison:
    """Both graphs in one configuration."""

    configuration: Configuration
    real: Side
    bare: Side
    latencies: tuple[Latency, ...]
    alike: Check | None

    def latency(self, hop: str) -> Latency | None:
        """Return a hop's latency, or None if no run has it."""
        return next((latency for latency in self.latencies if latency.hop == hop), None)


def compare(
    configuration: Configuration, runs: Sequence[Run], answering: Mapping[str, str], point: str
) -> Comparison:
    """Return the comparison of a configuration's runs.

    Args:
        configuration: which runs to take.
        runs: of any configuration.
        answering: node that answers -> clocked node whose samples it answers.
        point: operational point that is held.
    """
    mine = [run for run in runs if run.step.configuration == configuration]
    real, bare = ([run for run in mine if run.step.kind == kind] for kind in KINDS)
    shown = [[run for run in side if not run.failure] for side in (real, bare)]
    bags = [[run.recorded for run in side if run.recorded is not None] for side in shown]
    return Comparison(
        configuration,
        _side(real, configuration.rate_hz, answering),
        _side(bare, configuration.rate_hz, answering),
        (
            *_latencies("nodes", *([run.said for run in side] for side in shown)),
            *_latencies("recorder", *([bag.hops for bag in side] for side in bags)),
        ),
        check_sizes(bags[0][0], bags[1][0], point) if all(bags) else None,
    )


def _latencies(
    by: str, real: Sequence[Mapping[str, Percentiles]], bare: Sequence[Mapping[str, Percentiles]]
) -> list[Latency]:
    found = []
    for name in dict.fromkeys(hop for run in (*real, *bare) for hop in run):
        one = median_of([run[name] for run in real if name in run])
        other = median_of([run[name] for run in bare if name in run])
        both = ratios(one, other) if one is not None and other is not None else {}
        found.append(Latency(name, by, one, other, both))
    return found


def _side(runs: Sequence[Run], rate_hz: float, answering: Mapping[str, str]) -> Side:
    shown = [run for run in runs if not run.failure]
    broken = [
        f"run {run.step.repeat}: {reason}"
        for run in runs
        for reason in (
            [run.failure]
            if run.failure
            else [f"{check.rule}: {check.seen}" for check in run.checks if not check.held]
        )
    ]
    loads = [run.load for run in shown if run.load is not None]
    bags = [run.recorded for run in shown if run.recorded is not None]
    return Side(
        len(shown),
        sum(run.sound for run in shown),
        tuple(broken),
        {node: _kept(shown, node, rate_hz) for node in _names([run.clocked for run in shown])},
        {
            node: statistics.median(
                run.answers_hz[node] / max(run.clocked[asking].rate_hz, 1e-9) for run in shown
            )
            for node, asking in answering.items()
            if shown
        },
        {
            name: total([bag.losses[name] for bag in bags])
            for name in _names([bag.losses for bag in bags])
        },
        {
            name: statistics.median(load.cpu[name] for load in loads if name in load.cpu)
            for name in _names([load.cpu for load in loads])
        },
        max((load.stolen for load in loads), default=0.0),
    )


def _kept(runs: Sequence[Run], node: str, rate_hz: float) -> Kept:
    found = [run.clocked[node] for run in runs]
    periods = sum(one.periods for one in found)
    return Kept(
        max((one.rate_hz for one in found), key=lambda rate: abs(rate - rate_hz)),
        sum(one.missed for one in found) / periods if periods else 1.0,
        sum(one.dropped for one in found),
    )


def _names(mappings: Sequence[Mapping[str, object]]) -> list[str]:
    return list(dict.fromkeys(name for mapping in mappings for name in mapping))
