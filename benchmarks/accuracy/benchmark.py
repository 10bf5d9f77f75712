"""The accuracy benchmark: cases, each by every integrator at several steps."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import groupby
from math import log
from pathlib import Path
from typing import Annotated, ClassVar

import typer
from matplotlib.figure import Figure

from benchmarks.accuracy.cases import Case
from benchmarks.accuracy.endurance import endurance
from benchmarks.accuracy.figure import drawn
from benchmarks.accuracy.plan import Setting, settings
from benchmarks.accuracy.run import Run, measure
from benchmarks.machine import MachineResults, machine
from hapticmech_ros.analysis.study import Sheet, Show, judged, plain, silent
from hapticmech_ros.cli.console import OutOption, words
from hapticmech_ros.cli.study import FigureOption, JsonOption, carry_out, numbers

HEADINGS = ("integrator", "step", "error", "energy", "closure", "ranks", "CPU", "faster")
# Beside the table of a document, and below those of a terminal.
LEGEND = (
    "step: * is the scene's own, with its own integrator. error: largest against the reference, m "
    "or rad. energy: largest difference from what it should stay at, J. closure: largest residual "
    "of a closed loop, m or rad. ranks: samples at which the closures' rank changes / singular "
    "positions passed. CPU: s per simulated second, in steps only. faster: than "
    "real time, times."
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
            caption = "\n".join(_why(*entry) for entry in failures.items())
            rows = tuple(_marked(run) for run in members)
            yield Sheet(f"{titles.get(name, name)} ({name})", HEADINGS, rows, caption=caption)

    def notes(self) -> list[str]:
        """Return what the machine is, and what the columns mean."""
        return [*super().notes(), LEGEND]

    def figures(self) -> Mapping[str, Figure]:
        """Return error over CPU time."""
        return {"bench_accuracy.png": drawn(self.runs, self.known)}

    def markdown(self) -> str:
        """Return a table: of each case and integrator the run nearest the case's own step."""
        own = {case.name: case.scene.simulation.period for case in self.known}
        nearest: dict[tuple[str, str], Run] = {}
        for run in sorted(self.runs, key=lambda run: abs(log(run.step / own[run.case]))):
            nearest.setdefault((run.case, run.integrator), run)
        chosen = [run for run in self.runs if run is nearest[run.case, run.integrator]]
        rows = tuple((run.case, *cells(run)) for run in chosen)
        return Sheet("accuracy", ("case", *HEADINGS), rows).markdown()


def run_accuracy(
    chosen: Sequence[Setting], show: Show = silent, compiled: bool = True
) -> AccuracyResults:
    """Carry out all runs."""
    runs = []
    for number, setting in enumerate(chosen, start=1):
        show(f"{number} of {len(chosen)}: {setting}")
        runs.append(measure(setting, compiled))
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
    multiples = numbers("--steps", steps, float)
    chosen = settings(words(names), words(integrators), multiples, quick)
    carry_out(lambda show: run_accuracy(chosen, show), out, json_only, figure)


def cells(run: Run) -> tuple[str, ...]:
    """Return a run's line, a text for each of ``HEADINGS``."""
    step = step_text(run.step) + (" *" if run.own else "")
    if run.error is None or run.cpu_s_per_s is None or run.real_time is None:
        return (run.integrator, step, "failed", "", "", "", "", "")
    energy = "" if run.energy_error is None else f"{run.energy_error:.1e}"
    return (
        run.integrator,
        step,
        f"{run.error:.1e}",
        energy,
        f"{run.closure_error:.0e}" if run.rank else "",
        _ranks(run) if run.rank else "",
        f"{run.cpu_s_per_s:.3g}",
        f"{run.real_time:.3g}",
    )


def step_text(step: float) -> str:
    """Return a step in ms or µs, whichever has fewer digits."""
    return f"{1e3 * step:g} ms" if step >= 1e-3 else f"{1e6 * step:g} µs"


def _ranks(run: Run) -> str:
    text = f"{run.rank_changes}"
    if run.singular_times:
        text += f"/{run.singular_times}"
    return f"{text}, {run.unexpected_ranks} elsewhere" if run.unexpected_ranks else text


def _marked(run: Run) -> tuple[str, ...]:
    line = list(cells(run))
    if run.failure or run.kept is not None:
        line[2] = judged(line[2], run.kept is True)
    return tuple(line)


def _why(failure: str, who: list[str]) -> str:
    text = failure if len(failure) <= 160 else f"{failure[:157]}..."
    return f"{'; '.join(who)}: {text}"
