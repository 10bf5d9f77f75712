# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The graph's benchmark shown: sheets of a configuration, and a figure of all."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import fields

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullFormatter, ScalarFormatter

from benchmarks.graph.comparison import Comparison, Latency, Side
from benchmarks.graph.plan import LAYOUTS
from benchmarks.graph.statuses import ROUND_TRIP, Percentiles
from hapticmech_ros.analysis.study import Sheet, judged
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


def configuration_sheets(comparison: Comparison) -> Iterator[Sheet]:
    """Yield the tables of one configuration: latencies, then everything else."""
    if comparison.latencies:
        yield _latencies(comparison)
    yield _rest(comparison)


def _latencies(comparison: Comparison) -> Sheet:
    title = f"{comparison.configuration}: latency in µs, real / bare = ratio"
    names = [field.name for field in fields(Percentiles)]
    rows = tuple(
        (latency.hop, latency.by, *(_cell(latency, name) for name in names))
        for latency in comparison.latencies
    )
    headings = ("hop", "by", *(name.removesuffix("_us") for name in names))
    return Sheet(title, headings, rows, ("by",))


def _cell(latency: Latency, name: str) -> str:
    real, bare = (
        "-" if side is None else f"{getattr(side, name):.0f}"
        for side in (latency.real, latency.bare)
    )
    ratio = latency.ratio.get(name.removesuffix("_us"))
    return f"{real} / {bare}" + ("" if ratio is None else f" = {ratio:.2f}")


def _rest(comparison: Comparison) -> Sheet:
    real, bare = comparison.real, comparison.bare
    rows: list[tuple[str, ...]] = []

    def add(what: str, cells: Iterable[str]) -> None:
        rows.append((what, *cells))

    add("runs that gave figures", (str(real.runs), str(bare.runs)))
    add("runs that passed all checks", (str(real.sound), str(bare.sound)))
    for node in {**real.kept, **bare.kept}:
        add(f"{node}: rate, worst run, Hz", (_rate(s, node) for s in (real, bare)))
        add(f"{node}: missed deadlines", (_missed(s, node) for s in (real, bare)))
    for node in {**real.answered_share, **bare.answered_share}:
        shares = [_share(s.answered_share.get(node), 2) for s in (real, bare)]
        add(f"{node}: samples answered", shares)
    for name in {**real.losses, **bare.losses}:
        add(f"{name}: lost", (_lost(s, name) for s in (real, bare)))
    for process in {**real.cpu, **bare.cpu}:
        shares = [_share(s.cpu.get(process), 1) for s in (real, bare)]
        add(f"CPU of {process}, of one core", shares)
    add("stolen by the host, worst run", (_share(s.stolen, 1) for s in (real, bare)))
    if (alike := comparison.alike) is not None:
        add("same topics and sizes", (judged(alike.seen, alike.held), ""))
    for side in (real, bare):
        for failure in side.failures:
            add("check failed", [judged(failure, False) if side is s else "" for s in (real, bare)])
    return Sheet(str(comparison.configuration), ("", "real", "bare"), tuple(rows), ("real", "bare"))


def _rate(side: Side, node: str) -> str:
    return f"{side.kept[node].worst_hz:.1f}" if node in side.kept else "-"


def _missed(side: Side, node: str) -> str:
    if node not in side.kept:
        return "-"
    kept = side.kept[node]
    return f"{kept.missed_share:.2%}" + (f", {kept.dropped} dropped" if kept.dropped else "")


def _lost(side: Side, name: str) -> str:
    if name not in side.losses:
        return "-"
    found = side.losses[name]
    text = f"{found.lost} of {found.asked}"
    return text + (f"; {found.strays} by the recorder" if found.strays else "")


def _share(value: float | None, digits: int) -> str:
    return "-" if value is None else f"{value:.{digits}%}"


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
        _latency_panel(left, members, title)
        _cpu_panel(right, members)
    return figure


def _latency_panel(axes: Axes, members: Sequence[Comparison], title: str) -> None:
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


def _cpu_panel(axes: Axes, members: Sequence[Comparison]) -> None:
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
