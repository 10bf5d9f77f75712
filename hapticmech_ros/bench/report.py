"""A benchmark's results as tables for a terminal."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import fields

from rich.markup import escape
from rich.table import Table

from hapticmech_ros.bench.comparison import Comparison, Latency, Side
from hapticmech_ros.bench.goals import Verdict
from hapticmech_ros.bench.percentiles import Percentiles

SIDES = ("real", "bare")
COLOURS = {"pass": "green", "FAIL": "bold red", "not measured": "yellow"}


def configuration_tables(comparison: Comparison) -> Iterator[Table]:
    """Yield the tables of one configuration: latencies, then everything else."""
    if comparison.latencies:
        yield _latencies(comparison)
    yield _rest(comparison)


def goal_table(goals: tuple[Verdict, ...]) -> Table:
    """Return the goals and whether they are met."""
    table = Table(title="goals", title_justify="left")
    for column in ("goal", "measured", "outcome"):
        table.add_column(column, overflow="fold")
    for verdict in goals:
        colour = COLOURS[verdict.outcome]
        table.add_row(verdict.goal, escape(verdict.seen), f"[{colour}]{verdict.outcome}[/]")
    return table


def _latencies(comparison: Comparison) -> Table:
    title = f"{comparison.configuration}: latency in µs, real / bare = ratio"
    table = Table(title=title, title_justify="left")
    table.add_column("hop", overflow="fold")
    table.add_column("by")
    for field in fields(Percentiles):
        table.add_column(field.name.removesuffix("_us"), justify="right")
    for latency in comparison.latencies:
        cells = [_cell(latency, field.name) for field in fields(Percentiles)]
        table.add_row(latency.hop, latency.by, *cells)
    return table


def _cell(latency: Latency, name: str) -> str:
    real, bare = (
        "-" if side is None else f"{getattr(side, name):.0f}"
        for side in (latency.real, latency.bare)
    )
    ratio = latency.ratio.get(name.removesuffix("_us"))
    return f"{real} / {bare}" + ("" if ratio is None else f" = {ratio:.2f}")


def _rest(comparison: Comparison) -> Table:
    table = Table(title=str(comparison.configuration), title_justify="left")
    for column in ("", *SIDES):
        table.add_column(column, overflow="fold")
    real, bare = comparison.real, comparison.bare
    table.add_row("runs that gave figures", str(real.runs), str(bare.runs))
    table.add_row("runs that passed all checks", str(real.sound), str(bare.sound))
    for node in {**real.kept, **bare.kept}:
        table.add_row(f"{node}: rate, worst run, Hz", *(_rate(s, node) for s in (real, bare)))
        table.add_row(f"{node}: missed deadlines", *(_missed(s, node) for s in (real, bare)))
    for node in {**real.answered_share, **bare.answered_share}:
        shares = [_share(s.answered_share.get(node), 2) for s in (real, bare)]
        table.add_row(f"{node}: samples answered", *shares)
    for name in {**real.losses, **bare.losses}:
        table.add_row(f"{name}: lost", *(_lost(s, name) for s in (real, bare)))
    for process in {**real.cpu, **bare.cpu}:
        shares = [_share(s.cpu.get(process), 1) for s in (real, bare)]
        table.add_row(f"CPU of {process}, of one core", *shares)
    table.add_row("stolen by the host, worst run", *(_share(s.stolen, 1) for s in (real, bare)))
    if (alike := comparison.alike) is not None:
        colour = "green" if alike.held else "bold red"
        table.add_row("same topics and sizes", f"[{colour}]{escape(alike.seen)}[/]", "")
    for side, name in zip((real, bare), SIDES, strict=True):
        for failure in side.failures:
            cells = [f"[bold red]{escape(failure)}[/]" if name == which else "" for which in SIDES]
            table.add_row("check failed", *cells)
    return table


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
