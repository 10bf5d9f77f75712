# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The accuracy benchmark: cases, each by every integrator at several steps."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import groupby
from math import log
from pathlib import Path
from typing import Annotated, ClassVar

import typer
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from benchmarks.accuracy.cases import Case
from benchmarks.accuracy.endurance import endurance
from benchmarks.accuracy.run import INTEGRATOR_NAMES, Run, Setting, measure, settings
from benchmarks.machine import MachineResults, machine, speed_line
from benchmarks.work_precision import SMALLEST, Looks, finish, panels
from hapticmech_ros.analysis.study import Sheet, Show, judged, plain, silent
from hapticmech_ros.cli.console import OutOption, words
from hapticmech_ros.cli.study import FigureOption, JsonOption, carry_out, numbers
from hapticmech_ros.experiment.figure_style import (
    BLUE,
    GREEN,
    GREY,
    ORANGE,
    PURPLE,
    VERMILION,
)

HEADINGS = ("integrator", "step", "error", "energy", "closure", "ranks", "CPU", "faster")
# Beside the table of a document, and below those of a terminal.
LEGEND = (
    "step: * is the scene's own, with its own integrator. error: largest against the reference, m "
    "or rad. energy: largest difference from what it should stay at, J. closure: largest residual "
    "of a closed loop, m or rad. ranks: samples at which the closures' rank changes / singular "
    "positions passed. CPU: s per simulated second, in steps only. faster: than "
    "real time, times."
)
CAPTION = (
    "Largest error against the reference over the CPU time that a simulated second takes, "
    "both logarithmic. Along a line the step changes; filled marks are a scene's own step and "
    "integrator. Left of the dotted line is faster than real time. Runs that failed, and "
    "integrators without a run, have no mark."
)
LOOKS = dict(
    zip(
        INTEGRATOR_NAMES,
        zip((BLUE, ORANGE, GREEN, VERMILION, PURPLE), "osD^v", strict=True),
        strict=False,
    )
)


@dataclass(frozen=True)
class AccuracyResults(MachineResults):
    """All that the benchmark found.

    Attributes:
        runs: in the order of the settings.
        known: cases that were run.
    """

    NAME: ClassVar[str] = "bench_accuracy"
    FAULT: ClassVar[str] = "a case misses its tolerance with its own step and integrator"

    runs: tuple[Run, ...]
    known: tuple[Case, ...] = ()

    @property
    def sound(self) -> bool:
        """Whether every case that ran with its own step and integrator came within tolerance."""
        return all(run.kept is True for run in self.runs if run.own)

    def document(self) -> dict[str, object]:
        """Return machine and runs; cases are known."""
        return {"machine": plain(self.machine), "runs": plain(self.runs), "sound": self.sound}

    def sheets(self) -> Iterator[Sheet]:
        """Yield a table for each case, in the order of the runs."""
        titles = {case.name: f"{case.problem} {case.title}" for case in self.known}
        for name, group in groupby(self.runs, key=lambda run: run.case):
            members = list(group)
            failures: dict[str, list[str]] = {}
            for run in members:
                if run.failure:
                    text = f"{run.integrator}, {step_text(run.step)}"
                    failures.setdefault(run.failure, []).append(text)
            caption = "\n".join(f"{'; '.join(who)}: {why[:160]}" for why, who in failures.items())
            rows = tuple(_marked(run) for run in members)
            yield Sheet(f"{titles.get(name, name)} ({name})", HEADINGS, rows, caption=caption)

    def notes(self) -> list[str]:
        """Return what the machine is, and what the columns mean."""
        return [*super().notes(), LEGEND]

    def figures(self) -> Mapping[str, Figure]:
        """Return error over CPU time."""
        return {"bench_accuracy.png": drawn(self.runs, self.known)}

    def markdown(self) -> str:
        """Return a table: of each case and integrator the run nearest the case's own step.

        Below it is how fast the machine was.
        """
        own = {case.name: case.scene.simulation.period for case in self.known}
        nearest: dict[tuple[str, str], Run] = {}
        for run in sorted(self.runs, key=lambda run: abs(log(run.step / own[run.case]))):
            nearest.setdefault((run.case, run.integrator), run)
        chosen = [run for run in self.runs if run is nearest[run.case, run.integrator]]
        rows = tuple((run.case, *cells(run)) for run in chosen)
        table = Sheet("accuracy", ("case", *HEADINGS), rows).markdown()
        return f"{table}\n{speed_line(self.machine)}\n"


def run_accuracy(chosen: Sequence[Setting], show: Show = silent) -> AccuracyResults:
    """Carry out all runs."""
    runs = []
    for number, setting in enumerate(chosen, start=1):
        show(f"{number} of {len(chosen)}: {setting}")
        runs.append(measure(setting))
        if runs[-1].failure:
            show(f"  failed: {runs[-1].failure}")
    known = {setting.case.name: setting.case for setting in chosen}
    return AccuracyResults(machine(), tuple(runs), tuple(known.values()))


def accuracy(
    names: Annotated[str, typer.Option("--cases", help="by name; all if not given")] = "",
    integrators: Annotated[str, typer.Option(help="by name; all if not given")] = "",
    steps: Annotated[
        str, typer.Option(help="in steps of each scene's own; 4,2,1,0.5,0.25 if not given")
    ] = "",
    quick: Annotated[
        bool, typer.Option("--quick", help="two steps a case, none of the large ones")
    ] = False,
    long: Annotated[
        bool,
        typer.Option("--long", help="an hour of Bricard's mechanism and a minute of A02 instead"),
    ] = False,
    out: OutOption = Path("bench"),
    figure: FigureOption = None,
    json_only: JsonOption = False,
) -> None:
    """Compare integrators with mechanisms whose motion is known: error, energy, CPU time."""
    if long:
        carry_out(endurance, out, json_only)
        return
    chosen = settings(words(names), words(integrators), numbers("--steps", steps, float), quick)
    carry_out(lambda show: run_accuracy(chosen, show), out, json_only, figure)


def cells(run: Run) -> tuple[str, ...]:
    """Return a run's line, a text for each of ``HEADINGS``."""
    step = step_text(run.step) + (" *" if run.own else "")
    if run.error is None or run.cpu_s_per_s is None or run.real_time is None:
        return (run.integrator, step, "failed", "", "", "", "", "")
    return (
        run.integrator,
        step,
        f"{run.error:.1e}",
        "" if run.energy_error is None else f"{run.energy_error:.1e}",
        f"{run.closure_error:.0e}" if run.rank else "",
        _ranks(run) if run.rank else "",
        f"{run.cpu_s_per_s:.3g}",
        f"{run.real_time:.3g}",
    )


def step_text(step: float) -> str:
    """Return a step in ms or µs, whichever has fewer digits."""
    return f"{1e3 * step:g} ms" if step >= 1e-3 else f"{1e6 * step:g} µs"


def _ranks(run: Run) -> str:
    passed = f"/{run.singular_times}" if run.singular_times else ""
    elsewhere = f", {run.unexpected_ranks} elsewhere" if run.unexpected_ranks else ""
    return f"{run.rank_changes}{passed}{elsewhere}"


def _marked(run: Run) -> tuple[str, ...]:
    line = list(cells(run))
    if run.failure or run.kept is not None:
        line[2] = judged(line[2], run.kept is True)
    return tuple(line)


def drawn(runs: Sequence[Run], known: Sequence[Case]) -> Figure:
    """Return a figure of the runs that did not fail."""
    names = {case.name: f"{case.problem} {case.title}" for case in known}
    titles = {run.case: names.get(run.case, run.case) for run in runs}
    integrators = {run.integrator for run in runs if run.error is not None}
    looks: Looks = {name: look for name, look in LOOKS.items() if name in integrators}
    figure, places = panels(titles, looks, CAPTION, face="white")
    for name, axes in places.items():
        members = [run for run in runs if run.case == name]
        for integrator, look in looks.items():
            _curve(axes, [run for run in members if run.integrator == integrator], *look)
        finish(axes, members[0].unit)
        axes.axvline(1.0, color=GREY, linestyle=":", linewidth=1.2, zorder=1)
        axes.set_xlim(_decades(axes.get_xlim()))
        axes.set_ylim(_decades(axes.get_ylim()))
    return figure


def _curve(axes: Axes, members: Sequence[Run], colour: str, mark: str) -> None:
    """Draw the runs of an integrator along its steps; the scene's own is filled."""
    points = [
        (run.cpu_s_per_s, max(run.error, SMALLEST), run.own)
        for run in sorted(members, key=lambda run: run.step)
        if run.error is not None and run.cpu_s_per_s is not None
    ]
    work, errors = [x for x, _, _ in points], [y for _, y, _ in points]
    axes.plot(work, errors, "-", color=colour, marker=mark, mfc="white")
    for x, y, own in points:
        if own:
            axes.plot([x], [y], color=colour, marker=mark)


def _decades(limits: tuple[float, float]) -> tuple[float, float]:
    """Return limits that are two decades apart at least, so that there is a tick with a number."""
    low, high = limits
    middle = (low * high) ** 0.5
    return min(low, 0.1 * middle), max(high, 10.0 * middle)
