# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The speed benchmark shown: sheets, and error over CPU time, a panel for each scene."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from math import isfinite

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from benchmarks.accuracy.benchmark import step_text
from benchmarks.goals import Verdict, goal_sheet
from benchmarks.speed.contender import setting_text
from benchmarks.speed.equality import Check
from benchmarks.speed.fronts import TARGETS, cost, front, ratios
from benchmarks.speed.own_peer import NAME as OWN
from benchmarks.speed.problems import Problem
from benchmarks.speed.result import RunResult
from benchmarks.speed.scaling import TITLES, Growth
from benchmarks.speed.tick import TickTime
from benchmarks.work_precision import SMALLEST, finish, panels
from hapticmech_ros.analysis.study import Sheet, judged
from hapticmech_ros.experiment.figure_style import BLUE, GREEN, GREY, VERMILION

# Columns of words, which stand to the left.
WORDS = ("peer", "method", "outcome", "closures")
LOOKS = {
    "hapticmech": (BLUE, "o"),
    "mujoco": (VERMILION, "s"),
    "pinocchio": (GREEN, "D"),
}
CAPTION = (
    "Largest error against the reference over the CPU time of a simulated second, both "
    "logarithmic: down and to the left is better. A line joins a peer's best runs, over all its "
    "methods and steps; pale marks are its other runs. Dotted: the errors at which times are "
    "compared."
)


def sheets(
    checks: Sequence[Check],
    results: Sequence[RunResult],
    grown: Sequence[Growth],
    ticks: Sequence[TickTime],
    goals: Sequence[Verdict],
) -> Iterator[Sheet]:
    """Yield the tables of what there is."""
    yield _equality(checks)
    if results:
        yield _costs(results)
        yield _runs(results)
    for sizes in dict.fromkeys(one.sizes for one in grown):
        yield _growth([one for one in grown if one.sizes == sizes])
    if ticks:
        yield _ticks(ticks)
    if goals:
        yield goal_sheet(goals)


def _equality(checks: Sequence[Check]) -> Sheet:
    rows = tuple(
        (
            check.problem,
            check.peer,
            check.method,
            _scientific(check.coarse),
            _scientific(check.fine),
            _scientific(check.bound) if check.suitable else "",
            judged("pass", True)
            if check.passed
            else check.reason
            if check.suitable
            else f"no: {check.reason}",
        )
        for check in checks
    )
    return Sheet(
        "equality: error at two steps, m or rad",
        ("scene", "peer", "method", "coarse", "fine", "bound", "outcome"),
        rows,
        WORDS,
    )


def _costs(results: Sequence[RunResult]) -> Sheet:
    peers = list(dict.fromkeys(result.peer for result in results))
    known = {(ratio.problem, ratio.target): ratio for ratio in ratios(results, OWN)}
    rows = []
    for name in dict.fromkeys(result.problem for result in results):
        members = [result for result in results if result.problem == name]
        for target in TARGETS:
            cells = [_milli(cost(front(members, peer), target)) for peer in peers]
            ratio = known[name, target]
            value = "" if ratio.value is None else f"{ratio.value:.2f} ({ratio.best_peer})"
            rows.append((name, f"{target:.0e}", *cells, value))
    return Sheet(
        "CPU time at equal error, ms per simulated second",
        ("scene", "error", *peers, "ours / best peer"),
        tuple(rows),
    )


def _runs(results: Sequence[RunResult]) -> Sheet:
    rows = tuple(
        (
            result.problem,
            result.peer,
            result.method,
            step_text(result.step),
            _scientific(result.error) or result.failure,
            *(_milli(time) for time in (result.median, result.p90, result.slowest)),
            setting_text(result.setting),
        )
        for result in results
        if result.raced
    )
    return Sheet(
        "runs that were timed: CPU time, ms per simulated second",
        ("scene", "peer", "method", "step", "error", "median", "p90", "max", "closures"),
        rows,
        WORDS,
    )


def _growth(grown: Sequence[Growth]) -> Sheet:
    sizes = grown[0].sizes
    rows = tuple(
        (
            TITLES[one.family],
            one.peer,
            one.method,
            *("-" if cpu is None else f"{1e6 * cpu:.1f}" for cpu in one.cpu_s_per_step),
            "" if one.exponent is None else f"{one.exponent:.2f}",
        )
        for one in grown
    )
    headings = ("family", "peer", "method", *(f"N = {size}" for size in sizes), "exponent")
    return Sheet("CPU time of a step over size, µs", headings, rows, WORDS)


def _ticks(ticks: Sequence[TickTime]) -> Sheet:
    rows = tuple(
        (tick.name, *(f"{1e6 * time:.2f}" for time in (tick.median, tick.p90, tick.slowest)))
        for tick in ticks
    )
    return Sheet("a tick of the five-bar, CPU time, µs", ("call", "median", "p90", "max"), rows)


def _scientific(value: float) -> str:
    return f"{value:.1e}" if isfinite(value) else ""


def _milli(time: float | None) -> str:
    return "not reached" if time is None else f"{1e3 * time:.3g}"


def drawn(results: Sequence[RunResult], known: Sequence[Problem]) -> Figure:
    """Return a figure of the runs that have an error."""
    looks = {peer: LOOKS[peer] for peer in dict.fromkeys(result.peer for result in results)}
    problems = [one for one in known if any(result.problem == one.name for result in results)]
    titles = {problem.name: problem.title for problem in problems}
    figure, places = panels(titles, looks, CAPTION)
    for problem in problems:
        axes = places[problem.name]
        members = [result for result in results if result.problem == problem.name]
        for target in TARGETS:
            axes.axhline(target, color=GREY, linestyle=":", linewidth=1.0, zorder=1)
        for peer in dict.fromkeys(result.peer for result in members):
            _curve(axes, [result for result in members if result.peer == peer], *looks[peer])
        finish(axes, "m" if problem.kind == "point" else "rad")
    return figure


def _curve(axes: Axes, members: Sequence[RunResult], colour: str, mark: str) -> None:
    """Draw all runs of a peer, pale, and the best ones joined by a line."""
    runs = [
        (result.median, max(result.error, SMALLEST)) for result in members if not result.failure
    ]
    if runs:
        axes.plot(*zip(*runs, strict=True), mark, color=colour, alpha=0.25, markersize=4)
    points = front(members, members[0].peer)
    times, errors = [one.cpu_s_per_s for one in points], [one.error for one in points]
    axes.plot(times, errors, "-", color=colour, marker=mark)
