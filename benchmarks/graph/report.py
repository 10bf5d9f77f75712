"""Sheets of a configuration: latencies, then everything else."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import fields

from benchmarks.graph.comparison import Comparison, Latency, Side
from benchmarks.graph.percentiles import Percentiles
from hapticmech_ros.analysis.study import Sheet, judged


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
