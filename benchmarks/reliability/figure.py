# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What a part of the campaign found: one figure, its limit, and whether it was kept."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from benchmarks.machine import SCENE, SUMMED, speed

# Name of the figure by which those of different days are compared.
MACHINE = f"speed of the machine: one analysis of {SCENE}"


@dataclass(frozen=True, slots=True)
class Figure:
    """One measured figure.

    Attributes:
        name: what was measured.
        value: the figure; NaN where it could not be measured.
        unit: its unit.
        most, least: bounds that it has to keep, both included; None for none.
        trials: how many trials it summarises.
        note: what a reader has to know, such as why it was not measured.
        part: of the campaign, such as ``clocks``; the campaign knows.
    """

    name: str
    value: float
    unit: str = ""
    most: float | None = None
    least: float | None = None
    trials: int = 0
    note: str = ""
    part: str = ""

    @property
    def kept(self) -> bool:
        """Whether the figure was measured and keeps its bounds."""
        most = math.inf if self.most is None else self.most
        least = -math.inf if self.least is None else self.least
        return least <= self.value <= most


def figures_of(where: str, trials: int) -> Callable[..., Figure]:
    """Return what makes figures from a name and the further arguments of :class:`Figure`.

    Args:
        where: the figures are from; stands before each name.
        trials: that each summarises, unless it is given others.
    """

    def figure(name: str, value: float, unit: str = "", **more: Any) -> Figure:
        return Figure(f"{where}: {name}", value, unit, **{"trials": trials, **more})

    return figure


def unmeasured(name: str, why: str) -> Figure:
    """Return a figure of what could not be measured: it has a limit, which it does not keep."""
    return Figure(name, math.nan, "", 0.0, note=why)


def machine_speed() -> Figure:
    """Return how fast the machine is at the moment."""
    found = speed()
    note = f"sum(range({SUMMED:_})): {found['python_loop_us']:.0f} µs"
    return Figure(MACHINE, found["analysis_us"], "µs", note=note)


def save(figures: Sequence[Figure], path: Path) -> None:
    """Write figures as JSON."""
    path.write_text(json.dumps([asdict(figure) for figure in figures], indent=1), "utf-8")


def load(path: Path) -> list[Figure]:
    """Read figures back."""
    return [Figure(**one) for one in json.loads(path.read_text("utf-8"))]


def table(figures: Sequence[Figure]) -> str:
    """Return the figures as a table in Markdown."""
    rows = ["| part | measured | trials | figure | limit | kept |", "|---|---|---|---|---|---|"]
    for one in figures:
        bounds = (("≥", one.least), ("≤", one.most))
        limits = [f"{sign} {bound:g}" for sign, bound in bounds if bound is not None]
        kept = ("yes" if one.kept else "**no**") if limits else ""
        name = f"{one.name} ({one.note})" if one.note else one.name
        value = "not measured" if math.isnan(one.value) else f"{one.value:.4g} {one.unit}".strip()
        cells = (one.part, name, str(one.trials), value, " and ".join(limits), kept)
        rows.append(f"| {' | '.join(cells)} |")
    return "\n".join(rows) + "\n"
