"""The benchmark's picture: latency over rate, real and bare, and CPU time by node."""

from __future__ import annotations

from collections.abc import Sequence

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullFormatter, ScalarFormatter

from benchmarks.graph.comparison import Comparison, Side
from benchmarks.graph.plan import LAYOUTS
from benchmarks.graph.statuses import ROUND_TRIP
from hapticmech_ros.experiment.figure_style import (
    BLUE,
    GREEN,
    GREY,
    ORANGE,
    PURPLE,
    SKY,
    SMALL,
    TEXT,
    VERMILION,
    dress,
    legend,
    new_figure,
)

SHARES = {"p50_us": "-", "p99_us": "--"}
PROCESS_COLOURS = {
    "haptic_device": BLUE,
    "mechanism_simulator": VERMILION,
    "nullspace_analyser": GREEN,
    "teleoperation_controller": PURPLE,
    "composed": ORANGE,
    "recorder": SKY,
    "probe": GREY,
}


def drawn(comparisons: Sequence[Comparison], seconds: float, repeats: int) -> Figure:
    """Return a figure of one row for each layout and recording."""
    groups = {
        (one.configuration.layout, one.configuration.recorded): [
            other
            for other in comparisons
            if other.configuration.layout == one.configuration.layout
            and other.configuration.recorded == one.configuration.recorded
        ]
        for one in comparisons
    }
    caption = (
        f"Left: latency of {ROUND_TRIP} as the device measures it, from the deadline of a "
        f"sample to the arrival of its answer; medians over runs of {seconds:g} s, "
        f"{repeats} of each graph. "
        "Right: CPU time by process; for each rate the left bar is the real graph and the "
        "hatched one the bare graph, which passes the same messages and computes nothing."
    )
    figure = new_figure(11.0, 3.6 * len(groups), caption)
    rows = figure.subplots(len(groups), 2, squeeze=False)
    ordered = sorted(groups, key=lambda group: (LAYOUTS.index(group[0]), group[1]))
    for (left, right), key in zip(rows, ordered, strict=True):
        members = sorted(groups[key], key=lambda one: one.configuration.rate_hz)
        title = f"{key[0]}, {'recording' if key[1] else 'no recording'}"
        _latencies(left, members, title)
        _cpu(right, members)
    return figure


def _latencies(axes: Axes, members: Sequence[Comparison], title: str) -> None:
    for kind, colour in (("real", BLUE), ("bare", ORANGE)):
        for share, line in SHARES.items():
            points = [
                (one.configuration.rate_hz, getattr(side, share))
                for one in members
                if (latency := one.latency(ROUND_TRIP)) is not None
                and (side := getattr(latency, kind)) is not None
            ]
            if points:
                label = f"{kind}, {share.removesuffix('_us')}"
                axes.plot(*zip(*points, strict=True), line, color=colour, marker="o", label=label)
    rates = [one.configuration.rate_hz for one in members]
    axes.set_xscale("log", base=2)
    axes.set_yscale("log")
    axes.set_xticks(rates, [f"{rate:g}" for rate in rates])
    dress(axes, "control rate (Hz)", "round trip (µs)")
    axes.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    axes.yaxis.set_major_formatter(ScalarFormatter())
    axes.yaxis.set_minor_formatter(NullFormatter())
    if axes.lines:
        legend(axes, 2)
    axes.set_title(title, fontsize=TEXT, loc="left", pad=38)


def _cpu(axes: Axes, members: Sequence[Comparison]) -> None:
    named: set[str] = set()
    for index, one in enumerate(members):
        for offset, side, hatch in ((-0.2, one.real, ""), (0.2, one.bare, "///")):
            _stack(axes, index + offset, side, hatch, named)
    rates = [f"{one.configuration.rate_hz:g}" for one in members]
    axes.set_xticks(range(len(members)), rates)
    axes.set_xlim(-0.6, len(members) - 0.4)
    dress(axes, "control rate (Hz)", "CPU time (% of one core)")
    if named:
        axes.legend(fontsize=SMALL, frameon=False, loc="upper left", bbox_to_anchor=(1.0, 1.0))


def _stack(axes: Axes, x: float, side: Side, hatch: str, named: set[str]) -> None:
    bottom = 0.0
    for process, share in side.cpu.items():
        label = None if process in named else process
        named.add(process)
        axes.bar(
            x,
            100.0 * share,
            0.36,
            bottom=bottom,
            color=PROCESS_COLOURS.get(process, GREY),
            edgecolor="white",
            hatch=hatch,
            label=label,
        )
        bottom += 100.0 * share
