"""The memory benchmark as a table for a terminal."""

from __future__ import annotations

from collections.abc import Sequence

from rich.box import SIMPLE_HEAD
from rich.markup import escape
from rich.table import Table

from hapticmech_ros.bench.memory.watch import Grown

MEBI = float(1 << 20)


def table(found: Sequence[Grown]) -> Table:
    """Return how large each process is, and whether it grows."""
    shown = Table(title="resident size after the warm-up, MiB", title_justify="left")
    shown.box = SIMPLE_HEAD
    shown.add_column("process", overflow="fold")
    numbers = ("ticks", "first", "last", "largest", "private, first", "last", "slope, B/s", "±")
    for name in numbers:
        shown.add_column(name, justify="right")
    shown.add_column("verdict")
    for one in found:
        trend, private = one.trend, (one.private_first, one.private_last)
        colour = "green" if trend.flat else "bold red"
        shown.add_row(
            escape(one.name if one.where == one.name else f"{one.where}: {one.name}"),
            f"{one.ticks}",
            *(f"{size / MEBI:.2f}" for size in (trend.first, trend.last, trend.largest)),
            *("?" if size is None else f"{size / MEBI:.2f}" for size in private),
            f"{trend.slope:+.1f}",
            f"{trend.slope_error:.1f}",
            f"[{colour}]{trend.verdict}[/]",
        )
    return shown
