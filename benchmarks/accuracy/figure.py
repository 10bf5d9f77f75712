"""Work and precision: error over CPU time, one panel per case, one line per integrator."""

from __future__ import annotations

from collections.abc import Sequence

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import NullFormatter

from benchmarks.accuracy.cases import Case
from benchmarks.accuracy.plan import INTEGRATOR_NAMES
from benchmarks.accuracy.run import Run
from hapticmech_ros.experiment.figure_style import (
    BLUE,
    GREEN,
    GREY,
    ORANGE,
    PURPLE,
    TEXT,
    VERMILION,
    dress,
    new_figure,
)

COLUMNS = 3
LOOKS = dict(
    zip(
        INTEGRATOR_NAMES,
        zip((BLUE, ORANGE, GREEN, VERMILION, PURPLE), "osD^v", strict=True),
        strict=False,
    )
)
# A logarithm has no place for a run that gave the reference to the bit.
SMALLEST = 1e-16


def drawn(runs: Sequence[Run], known: Sequence[Case]) -> Figure:
    """Return a figure of the runs that did not fail."""
    titles = {case.name: f"{case.problem} {case.title}" for case in known}
    names = list(dict.fromkeys(run.case for run in runs))
    rows = max(1, -(-len(names) // COLUMNS))
    columns = max(1, min(COLUMNS, len(names)))
    caption = (
        "Largest error against the reference over the CPU time that a simulated second takes, "
        "both logarithmic. Along a line the step changes; filled marks are a scene's own step and "
        "integrator. Left of the dotted line is faster than real time. Runs that failed, and "
        "integrators without a run, have no mark."
    )
    figure = new_figure(4.2 * columns, 3.5 * rows, caption)
    panels = figure.subplots(rows, columns, squeeze=False).ravel()
    for axes, name in zip(panels, names, strict=False):
        members = [run for run in runs if run.case == name]
        _panel(axes, members)
        axes.set_title(titles.get(name, name), fontsize=TEXT, loc="left")
    for axes in panels[len(names) :]:
        axes.set_axis_off()
    drawn = {run.integrator for run in runs if run.error is not None}
    handles = [
        Line2D([], [], color=colour, marker=mark, mfc="white", label=name.replace("_", " "))
        for name, (colour, mark) in LOOKS.items()
        if name in drawn
    ]
    if handles:
        figure.legend(
            handles=handles, loc="outside upper left", ncols=4, fontsize=TEXT, frameon=False
        )
    return figure


def _panel(axes: Axes, members: Sequence[Run]) -> None:
    for integrator, (colour, mark) in LOOKS.items():
        points = [
            (run.cpu_s_per_s, max(run.error, SMALLEST), run.own)
            for run in sorted(members, key=lambda run: run.step)
            if run.integrator == integrator
            and run.error is not None
            and run.cpu_s_per_s is not None
        ]
        if not points:
            continue
        work, errors, own = zip(*points, strict=True)
        axes.plot(work, errors, "-", color=colour, marker=mark, mfc="white")
        for x, y in ((x, y) for x, y, is_own in zip(work, errors, own, strict=True) if is_own):
            axes.plot([x], [y], color=colour, marker=mark)
    axes.set_xscale("log")
    axes.set_yscale("log")
    unit = members[0].unit if members else "m"
    dress(axes, "CPU time per simulated second (s)", f"error ({unit})")
    axes.axvline(1.0, color=GREY, linestyle=":", linewidth=1.2, zorder=1)
    axes.set_xlim(_decades(axes.get_xlim()))
    axes.set_ylim(_decades(axes.get_ylim()))
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_minor_formatter(NullFormatter())


def _decades(limits: tuple[float, float]) -> tuple[float, float]:
    """Return limits that are two decades apart at least, so that there is a tick with a number."""
    low, high = limits
    middle = (low * high) ** 0.5
    return min(low, 0.1 * middle), max(high, 10.0 * middle)
