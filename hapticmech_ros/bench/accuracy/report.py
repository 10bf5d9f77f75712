"""The accuracy benchmark as tables: for a terminal, and for a document."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import groupby
from math import log

from rich.box import SIMPLE_HEAD
from rich.markup import escape
from rich.table import Table

from hapticmech_ros.bench.accuracy.cases import Case
from hapticmech_ros.bench.accuracy.run import Run

HEADINGS = ("integrator", "step", "error", "energy", "closure", "ranks", "CPU", "faster")
# Beside the table of a document, and below those of a terminal.
LEGEND = (
    "step: * is the scene's own, with its own integrator. error: largest against the reference, m "
    "or rad. energy: largest difference from what it should stay at, J. closure: largest residual "
    "of a closed loop, m or rad. ranks: samples at which the closures' rank changes / singular "
    "positions passed. CPU: s per simulated second, in steps only. faster: than "
    "real time, times."
)


def tables(runs: Sequence[Run], known: Sequence[Case]) -> Iterator[Table]:
    """Yield a table for each case, in the order of the runs."""
    titles = {case.name: f"{case.problem} {case.title}" for case in known}
    for name, members in groupby(runs, key=lambda run: run.case):
        table = Table(
            title=f"{titles.get(name, name)} ({name})",
            title_justify="left",
            caption_justify="left",
            box=SIMPLE_HEAD,
            padding=(0, 1, 0, 0),
        )
        for index, heading in enumerate(HEADINGS):
            table.add_column(heading, justify="left" if index == 0 else "right", overflow="fold")
        failures: dict[str, list[str]] = {}
        for run in members:
            table.add_row(*_coloured(run))
            if run.failure:
                about = f"{run.integrator}, {step_text(run.step)}"
                failures.setdefault(run.failure, []).append(about)
        if failures:
            table.caption = "\n".join(_why(*entry) for entry in failures.items())
        yield table


def markdown(runs: Sequence[Run], known: Sequence[Case]) -> str:
    """Return a table for a document: of each case and integrator the run nearest its own step."""
    own = {case.name: case.scene.simulation.period for case in known}
    nearest: dict[tuple[str, str], Run] = {}
    for run in sorted(runs, key=lambda run: abs(log(run.step / own[run.case]))):
        nearest.setdefault((run.case, run.integrator), run)
    chosen = [run for run in runs if run is nearest[run.case, run.integrator]]
    lines = ["| case | " + " | ".join(HEADINGS) + " |", "|---|---|" + "--:|" * (len(HEADINGS) - 1)]
    lines += [f"| {run.case} | " + " | ".join(cells(run)) + " |" for run in chosen]
    return "\n".join(lines) + "\n"


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


def _coloured(run: Run) -> list[str]:
    line = [escape(cell) for cell in cells(run)]
    if run.failure:
        line[2] = f"[bold red]{line[2]}[/]"
    elif run.kept is not None:
        line[2] = f"[{'green' if run.kept else 'bold red'}]{line[2]}[/]"
    return line


def _why(failure: str, who: list[str]) -> str:
    text = failure if len(failure) <= 160 else f"{failure[:157]}..."
    return escape(f"{'; '.join(who)}: {text}")
