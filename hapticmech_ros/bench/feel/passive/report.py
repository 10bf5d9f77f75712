"""Trials of passivity as a table for a terminal."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import groupby

from rich.box import SIMPLE_HEAD
from rich.markup import escape
from rich.table import Table

from hapticmech_ros.bench.feel.passive.trial import Found


def table(found: Sequence[Found]) -> Table:
    """Return, for each scene, loop and delay, the worst of its devices and hands."""
    shown = Table(
        title="worst device and hand: least energy, most force, chatter, commands changed, drift",
        title_justify="left",
    )
    shown.box = SIMPLE_HEAD
    for name in ("scene", "loop in"):
        shown.add_column(name, no_wrap=True)
    names = ("ms", "passive", "mJ", "N", "N/T", "changed", "mm")
    for name in names:
        shown.add_column(name, justify="right", no_wrap=True)
    ordered = sorted(found, key=_key)
    for (scene, local, delay), group in groupby(ordered, key=_key):
        rows = list(group)
        shown.add_row(
            escape(scene),
            "device" if local else "controller",
            f"{1e3 * delay:g}",
            f"{sum(one.passive for one in rows)} of {len(rows)}",
            f"{1e3 * min(one.lowest for one in rows):.2f}",
            f"{max(one.most_force for one in rows):.1f}",
            f"{max(one.chatter for one in rows):.2f}",
            f"{100.0 * max(one.changed for one in rows):.0f} %",
            f"{1e3 * max(one.drift for one in rows):.1f}",
        )
    return shown


def _key(found: Found) -> tuple[str, bool, float]:
    return found.trial.scene, found.trial.local, found.trial.delay
