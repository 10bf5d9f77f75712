"""The ablation as tables for a terminal."""

from __future__ import annotations

from collections.abc import Sequence

from rich.box import SIMPLE_HEAD
from rich.markup import escape
from rich.table import Table

from hapticmech_ros.bench.ablation.findings import Rung, Unused
from hapticmech_ros.bench.ablation.loop import PARTS


def ladder_table(rungs: Sequence[Rung]) -> Table:
    """Return what each feature costs."""
    table = Table(title="a tick of the session, µs", title_justify="left", box=SIMPLE_HEAD)
    table.add_column("scene", overflow="fold")
    for name in ("nv", "m", "rank", "apart", "p50", "p90", "p99", "ratio", "more", "±", *PARTS):
        table.add_column(name, justify="right")
    for rung in rungs:
        apart = f"{rung.apart:.0e}"
        table.add_row(
            escape(rung.name),
            *(str(number) for number in (rung.nv, rung.rows, rung.rank)),
            apart if rung.agrees else f"[bold red]{apart}[/]",
            *(f"{value:.1f}" for value in (rung.median_us, rung.p90_us, rung.p99_us)),
            f"{rung.ratio:.2f}",
            f"{rung.increment_us:+.1f}",
            f"{rung.error_us:.1f}",
            *(f"{rung.parts_us[part]:.1f}" for part in PARTS),
        )
    return table


def unused_table(found: Sequence[Unused]) -> Table:
    """Return what things cost that are there and not used."""
    table = Table(title="what is not used", title_justify="left", box=SIMPLE_HEAD)
    for name in ("", "without", "with it", "difference", "±", "verdict"):
        right = name in ("without", "with it", "difference", "±")
        table.add_column(name, justify="right" if right else "left", overflow="fold")
    for one in found:
        colour = "yellow" if one.costs else "green"
        table.add_row(
            escape(one.name),
            f"{one.without_us:.1f}",
            f"{one.having_us:.1f}",
            f"{one.increment_us:+.2f}",
            f"{one.error_us:.2f}",
            f"[{colour}]{escape(one.verdict)}[/]"
            if one.agrees
            else "[bold red]implementations do not agree[/]",
        )
    return table
