"""The comparison as a table for a terminal."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import groupby

import numpy as np
from rich.box import SIMPLE_HEAD
from rich.markup import escape
from rich.table import Table

from hapticmech_ros.bench.feel.comparison.ratio import FREQUENCIES_HZ
from hapticmech_ros.bench.feel.comparison.side_by_side import Column

NOTHING = "-"


def table(columns: Sequence[Column]) -> Table:
    """Return a row for each scene, delay and way to render."""
    shown = Table(
        title="the architecture beside simpler ones; drift and depth in mm", title_justify="left"
    )
    shown.box = SIMPLE_HEAD
    shown.add_column("", no_wrap=True)
    heads = ("2 Hz %", "10 Hz %", "held N/m", "rigid", "bears", "drift", "depth")
    for name in heads:
        shown.add_column(name, justify="right")
    for (scene, delay), group in groupby(columns, lambda row: (row.scene, row.delay)):
        shown.add_row(f"[bold]{escape(scene)}[/], delay {delay}")
        for row in group:
            seen = row.experience
            shown.add_row(
                row.variant,
                percent(error_at(row, 2)),
                percent(error_at(row, 10)),
                NOTHING if row.softest_held is None else f"{row.softest_held:.0f}",
                f"{row.count}/{row.constraints}",
                NOTHING if row.largest_delay is None else str(row.largest_delay),
                f"{1e3 * seen.drift_rms:.2g}" if seen.kept else "lost",
                f"{1e3 * seen.penetration_rms:.2g}" if seen.kept else "lost",
            )
    return shown


def error_at(row: Column, frequency: int) -> float:
    """Return the largest |felt / desired - 1| at one of the frequencies, Hz."""
    return row.errors[FREQUENCIES_HZ.index(frequency)]


def percent(value: float) -> str:
    """Return an error in percent, for a table."""
    return "lost" if not np.isfinite(value) else f"{100.0 * value:.3g}"
