"""The feel of scenes as a table for a terminal."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import groupby

from rich.box import SIMPLE_HEAD
from rich.markup import escape
from rich.table import Table

from hapticmech_ros.bench.feel.row import Row


def table(rows: Sequence[Row]) -> Table:
    """Return, for each scene, loop and delay, the worst of its directions."""
    shown = Table(title="felt over desired impedance, worst direction", title_justify="left")
    shown.box = SIMPLE_HEAD
    for name in ("scene", "loop in"):
        shown.add_column(name, no_wrap=True)
    for name in ("delay", "ways", "to 10 Hz", "to 30 Hz", "3 dB, Hz", "steady", "model"):
        shown.add_column(name, justify="right", no_wrap=True)
    for (scene, loop, delay), group in groupby(rows, lambda row: (row.scene, row.loop, row.delay)):
        found = [row.felt for row in group]
        shown.add_row(
            escape(scene),
            loop,
            str(delay),
            str(len(found)),
            f"{100.0 * max(one.error(10.0) for one in found):.1f} %",
            f"{100.0 * max(one.error(30.0) for one in found):.1f} %",
            f"{min(one.bandwidth for one in found):g}",
            f"{100.0 * max(one.steady_error(10.0) for one in found):.1f} %",
            f"{100.0 * max(one.model_error(30.0) for one in found):.1f} %",
        )
    shown.caption = (
        "steady: error to 10 Hz that the model leaves once the start has died away; "
        "model: how far it is from what was measured, to 30 Hz"
    )
    shown.caption_justify = "left"
    return shown
