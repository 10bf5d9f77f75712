"""The comparison as a table for a terminal."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from rich.box import SIMPLE_HEAD
from rich.markup import escape
from rich.table import Table

from hapticmech_ros.bench.feel.comparison.ratio import FREQUENCIES_HZ
from hapticmech_ros.bench.feel.comparison.side_by_side import Column

NOTHING = "-"


def table(columns: Sequence[Column]) -> Table:
    """Return a row for each scene, delay and way to render."""
    shown = Table(title="the architecture beside simpler ones", title_justify="left")
    shown.box = SIMPLE_HEAD
    for name in ("scene", "rendered by"):
        shown.add_column(name, no_wrap=True)
    heads = ("delay", "k N/m", "2 Hz", "10 Hz", "x mass", "held N/m", "rigid", "bears")
    for name in (*heads, "drift mm", "depth mm", "energy mJ"):
        shown.add_column(name, justify="right")
    for row in columns:
        seen = row.experience
        shown.add_row(
            escape(row.scene),
            row.variant,
            str(row.delay),
            f"{row.stiffness:.0f}",
            percent(error_at(row, 2)),
            percent(error_at(row, 10)),
            NOTHING if not np.isfinite(row.sizes[2]) else f"{row.sizes[2]:.2f}",
            NOTHING if row.softest_held is None else f"{row.softest_held:.0f}",
            f"{row.count} of {row.constraints}",
            f"{NOTHING if row.largest_delay is None else row.largest_delay} ({row.foreseen_delay})",
            f"{1e3 * seen.drift_rms:.3f}" if seen.kept else "lost",
            f"{1e3 * seen.penetration_rms:.3f}" if seen.kept else "lost",
            f"{1e3 * seen.left_energy:.3f}",
        )
    return shown


def error_at(row: Column, frequency: int) -> float:
    """Return the largest |felt / desired - 1| at one of the frequencies, Hz."""
    return row.errors[FREQUENCIES_HZ.index(frequency)]


def percent(value: float) -> str:
    """Return an error for a table."""
    return "unstable" if not np.isfinite(value) else f"{100.0 * value:.1f} %"
