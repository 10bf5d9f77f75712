"""Error over CPU time, one panel per scene, one line per peer: its front, and all runs behind."""

from __future__ import annotations

from collections.abc import Sequence

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import NullFormatter

from benchmarks.speed.fronts import SMALLEST, TARGETS, front
from benchmarks.speed.problems import Problem
from benchmarks.speed.result import RunResult
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
LOOKS = {
    "hapticmech": (BLUE, "o"),
    "mujoco": (VERMILION, "s"),
    "pinocchio": (GREEN, "D"),
    "exudyn": (PURPLE, "^"),
}
OTHER = (ORANGE, "v")
CAPTION = (
    "Largest error against the reference over the CPU time of a simulated second, both "
    "logarithmic: down and to the left is better. A line joins a peer's best runs, over all its "
    "methods and steps; pale marks are its other runs. Dotted: the errors at which times are "
    "compared."
)


def drawn(results: Sequence[RunResult], known: Sequence[Problem]) -> Figure:
    """Return a figure of the runs that have an error."""
    by_name = {problem.name: problem for problem in known}
    names = list(dict.fromkeys(result.problem for result in results))
    columns = max(1, min(COLUMNS, len(names)))
    rows = max(1, -(-len(names) // columns))
    figure = new_figure(4.2 * columns, 3.5 * rows, CAPTION)
    panels = figure.subplots(rows, columns, squeeze=False).ravel()
    for axes, name in zip(panels, names, strict=False):
        _panel(axes, [result for result in results if result.problem == name], by_name[name])
    for axes in panels[len(names) :]:
        axes.set_axis_off()
    handles = [
        Line2D([], [], color=_look(peer)[0], marker=_look(peer)[1], label=peer)
        for peer in dict.fromkeys(result.peer for result in results)
    ]
    if handles:
        figure.legend(
            handles=handles, loc="outside upper left", ncols=5, fontsize=TEXT, frameon=False
        )
    return figure


def _panel(axes: Axes, members: Sequence[RunResult], problem: Problem) -> None:
    for target in TARGETS:
        axes.axhline(target, color=GREY, linestyle=":", linewidth=1.0, zorder=1)
    for peer in dict.fromkeys(result.peer for result in members):
        colour, mark = _look(peer)
        others = [
            (result.median, max(result.error, SMALLEST))
            for result in members
            if result.peer == peer and result.median is not None and result.error is not None
        ]
        if others:
            axes.plot(*zip(*others, strict=True), mark, color=colour, alpha=0.25, markersize=4)
        points = front(members, peer)
        times = [point.cpu_s_per_s for point in points]
        axes.plot(times, [point.error for point in points], "-", color=colour, marker=mark)
    axes.set_xscale("log")
    axes.set_yscale("log")
    axes.xaxis.set_minor_formatter(NullFormatter())
    axes.set_title(problem.title, fontsize=TEXT, loc="left")
    dress(axes, "CPU time per simulated second (s)", f"error ({problem.length_unit})")


def _look(peer: str) -> tuple[str, str]:
    return LOOKS.get(peer, OTHER)
