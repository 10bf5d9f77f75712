# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A race: every peer's methods at several steps, compared once and then timed in turn."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from benchmarks.accuracy.cases import divides
from benchmarks.speed.contender import Contender, Method, Peer, State, initial_state
from benchmarks.speed.equality import Check
from benchmarks.speed.problems import Problem
from benchmarks.speed.result import RunResult, run_once, timed_in_turn
from hapticmech_ros.analysis.study import Show, silent

# Steps in units of a problem, coarse to fine, from this order on; those that do not divide a time
# of comparison are left out.
MULTIPLES = {
    3: (
        200.0,
        125.0,
        100.0,
        200.0 / 3.0,
        62.5,
        50.0,
        40.0,
        25.0,
        20.0,
        10.0,
        5.0,
        2.0,
        1.0,
        0.5,
        0.25,
    ),
    2: (10.0, 5.0, 2.0, 1.0, 0.5, 0.2, 0.1),
    0: (4.0, 2.0, 1.0, 0.5, 0.2, 0.1, 0.05, 0.02),
}
LARGE_MULTIPLES = {
    3: (100.0, 50.0, 25.0, 20.0, 10.0, 5.0, 2.0),
    0: (4.0, 2.0, 1.0, 0.5, 0.2),
}
QUICK = {5: (50.0, 20.0, 10.0), 3: (10.0, 5.0, 2.0), 0: (2.0, 1.0, 0.5)}
# Settings of closures that are tried at the next finer step: the best ones of a step that was not
# lost (m or rad), unless they are this much worse.
KEPT_SETTINGS, NOT_LOST, WORSE = 3, 1e-4, 10.0
# A run is left out of the timing if another of its peer is more accurate in so much of its time.
DOMINATED = 0.7
# Of the limit of a comparing run, for large problems.
LARGE_SHARE = 3.0


@dataclass(frozen=True, slots=True)
class Effort:
    """How much is spent.

    Attributes:
        repeats: timed runs of each result, the comparing one not counted.
        budget_s: CPU time of a timed run, at most: it ends where that is over.
        limit_s: CPU time that a comparing run may be expected to take; finer steps are left out.
        quick: few steps.
    """

    repeats: int = 5
    budget_s: float = 0.15
    limit_s: float = 4.0
    quick: bool = False


def race(
    problem: Problem,
    peers: Sequence[Peer],
    checks: Sequence[Check],
    effort: Effort,
    show: Show = silent,
) -> tuple[RunResult, ...]:
    """Return a result for every method and step of the peers that passed their check."""
    passed = {(c.problem, c.peer, c.method) for c in checks if c.passed}
    start = initial_state(problem.scene)
    results: list[tuple[RunResult, Contender | None]] = []
    for peer in peers:
        for method in peer.methods:
            if (problem.name, peer.name, method.name) in passed:
                show(f"{problem.name}: {peer.name}, {method.name}")
                results += _compare(problem, start, peer, method, effort)
    return _time(problem, results, effort)


def multiples_of(problem: Problem, method: Method, quick: bool) -> tuple[float, ...]:
    """Return the steps of a method in units of the problem, coarse to fine."""
    if method.multiples:
        return tuple(sorted(method.multiples, reverse=True))
    table = QUICK if quick else LARGE_MULTIPLES if problem.large else MULTIPLES
    steps = next(steps for order, steps in table.items() if method.order >= order)
    return tuple(
        one for one in steps if all(divides(one * problem.unit, time) for time in problem.times)
    )


def _compare(
    problem: Problem, start: State, peer: Peer, method: Method, effort: Effort
) -> list[tuple[RunResult, Contender | None]]:
    found: list[tuple[RunResult, Contender | None]] = []
    settings = method.settings_for(problem.scene)
    step_s = 0.0
    for multiple in multiples_of(problem, method, effort.quick):
        step = multiple * problem.unit
        limit_s = (LARGE_SHARE if problem.large else 1.0) * effort.limit_s
        if step_s * problem.times[-1] / step > limit_s:
            break
        tried = [run_once(problem, start, peer, method, step, setting) for setting in settings]
        tried.sort(key=lambda one: one[0].error)
        found.append(tried[0])
        best = tried[0][0]
        if not best.failure:
            step_s = best.median * step
        # All as long as none was good.
        if best.error <= NOT_LOST:
            ranked = [result for result, _ in tried[:KEPT_SETTINGS]]
            settings = tuple(one.setting for one in ranked if one.error <= WORSE * best.error)
    return found


def _time(
    problem: Problem, found: Sequence[tuple[RunResult, Contender | None]], effort: Effort
) -> tuple[RunResult, ...]:
    results = [result for result, _ in found]
    racers = {}
    # Peers in turn: sorted by step, neighbours are of different peers.
    for index in sorted(range(len(found)), key=lambda k: (-results[k].step, results[k].peer)):
        result, contender = found[index]
        if contender is not None and not _dominated(result, results):
            whole = round(problem.times[-1] / result.step)
            affordable = round(effort.budget_s / max(result.median * result.step, 1e-9))
            racers[index] = contender, max(1, min(whole, affordable))
    for index, times in timed_in_turn(racers, effort.repeats).items():
        measured = tuple(time / results[index].step for time in times)
        results[index] = replace(results[index], cpu_s_per_s=measured, raced=True)
    return tuple(results)


def _dominated(result: RunResult, results: Sequence[RunResult]) -> bool:
    """Return whether the same peer has a run with less error in clearly less time."""
    return any(
        other.peer == result.peer
        and other.error <= result.error
        and other.median < DOMINATED * result.median
        for other in results
    )
