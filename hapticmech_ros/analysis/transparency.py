# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Transparency: felt over desired impedance of scenes, for both loops and several delays."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import groupby
from typing import ClassVar

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from hapticmech_ros.analysis.impedance import Felt, felt
from hapticmech_ros.analysis.over_graph import felt_over_graph
from hapticmech_ros.analysis.scene_variants import LOOPS, of_first_user, with_loop
from hapticmech_ros.analysis.study import Results, Sheet, Show, complex_parts, silent
from hapticmech_ros.experiment.figure_style import (
    BLUE,
    GREY,
    ORANGE,
    about,
    at_least,
    dress,
    legend_outside,
    new_figure,
)
from hapticmech_ros.loading import load_scene

# Measured with a session, or with a graph of nodes in one process or in four.
OVER = ("session", "composed", "processes")
FIGURE_CAPTION = (
    "Felt over desired impedance along each free direction of each scene, at the smallest delay. "
    "With the loop in the device it corrects commands by what the hand has done since. Dotted: "
    "3 dB."
)
TABLE_CAPTION = (
    "steady: error to 10 Hz that the model leaves once the start has died away; "
    "model: how far it is from what was measured, to 30 Hz"
)
# What the axis of the phase shows at least, degrees.
LEAST_PHASE = 1.0
CIRCLES = {"marker": "o", "markersize": 4.0, "fillstyle": "none", "linestyle": "none"}


@dataclass(frozen=True, slots=True)
class Row:
    """Felt impedance along one direction of a scene.

    Attributes:
        scene: its name.
        loop: where the force channel is closed, device or controller; for a graph, its layout.
        delay: periods from measuring to acting.
        felt: felt impedance along the direction.
    """

    scene: str
    loop: str
    delay: int
    felt: Felt

    def document(self) -> dict[str, object]:
        """Return the row as plain lists and numbers."""
        found = self.felt
        return {
            "scene": self.scene,
            "loop": self.loop,
            "delay_periods": self.delay,
            "direction": found.direction.tolist(),
            "mass": found.mass,
            "frequencies_hz": found.frequencies.tolist(),
            **complex_parts(found, ("ratio", "predicted", "steady")),
            "error_to_10_hz": found.error(10.0),
            "error_to_30_hz": found.error(30.0),
            "steady_error_to_10_hz": found.steady_error(10.0),
            "model_error_to_30_hz": found.model_error(30.0),
            "bandwidth_hz": found.bandwidth,
        }


@dataclass(frozen=True)
class Transparency(Results):
    """Felt impedance of scenes.

    Attributes:
        rows: one for each direction.
    """

    NAME: ClassVar[str] = "impedance"

    rows: tuple[Row, ...]

    def document(self) -> list[dict[str, object]]:
        """Return the rows as plain dictionaries."""
        return [row.document() for row in self.rows]

    def sheets(self) -> Iterator[Sheet]:
        """Yield a row for each scene, loop and delay, with the worst of its directions."""
        lines = []
        for key, group in groupby(self.rows, lambda row: (row.scene, row.loop, row.delay)):
            found = [row.felt for row in group]
            lines.append(
                (
                    *map(str, (*key, len(found))),
                    _percent(max(one.error(10.0) for one in found)),
                    _percent(max(one.error(30.0) for one in found)),
                    f"{min(one.bandwidth for one in found):g}",
                    _percent(max(one.steady_error(10.0) for one in found)),
                    _percent(max(one.model_error(30.0) for one in found)),
                )
            )
        headings = ("scene", "loop in", "delay", "directions", "to 10 Hz", "to 30 Hz", "3 dB, Hz")
        yield Sheet(
            "error of felt impedance, worst direction",
            (*headings, "steady", "model"),
            tuple(lines),
            ("loop in",),
            TABLE_CAPTION,
        )

    def figures(self) -> Mapping[str, Figure]:
        """Return magnitude and phase of felt over desired impedance."""
        figure = new_figure(9.0, 4.0, about([row.scene for row in self.rows], FIGURE_CAPTION))
        sizes, phases = figure.subplots(1, 2)
        least = min((row.delay for row in self.rows), default=0)
        legend: dict[str, Line2D] = {}
        for row in self.rows:
            if row.delay != least:
                continue
            colour = ORANGE if row.loop == "controller" else BLUE
            ways = (
                ("measured", row.felt.ratio, {"linewidth": 1.0}),
                ("predicted by the model", row.felt.predicted, CIRCLES),
            )
            for way, ratio, style in ways:
                for axes, values in (
                    (sizes, 20.0 * np.log10(np.abs(ratio))),
                    (phases, np.rad2deg(np.angle(ratio))),
                ):
                    (line,) = axes.semilogx(
                        row.felt.frequencies, values, color=colour, alpha=0.7, **style
                    )
                legend.setdefault(f"loop in {row.loop}, {way}", line)
        for level in (-3.0, 3.0):
            sizes.axhline(level, color=GREY, linestyle=":", linewidth=1.0)
        dress(sizes, "frequency (Hz)", "magnitude (dB)")
        dress(phases, "frequency (Hz)", "phase (°)")
        at_least(phases, span=LEAST_PHASE)
        legend_outside(figure, list(legend.values()), list(legend), 2)
        return {"impedance.png": figure}


def transparency(
    scenes: Sequence[str], delays: Sequence[int], show: Show = silent, over: str = "session"
) -> Transparency:
    """Measure every scene with both loops and each delay.

    Over a graph the loop is closed in the device, and the delay is that of the graph.

    Args:
        scenes: names or paths.
        delays: periods from measuring to acting, each 0 or more.
        show: called with each scene.
        over: one of :data:`OVER`.

    Returns:
        Felt impedance of every scene, loop, delay and direction.

    Raises:
        SceneError: a scene that cannot be loaded.
        InvalidInputError: as :func:`~hapticmech_ros.analysis.impedance.felt`.
    """
    rows: list[Row] = []
    for name in scenes:
        scene = of_first_user(load_scene(name))
        show(f"{scene.name}: {scene.description}")
        if over != "session":
            rows += [
                Row(scene.name, over, 1, one) for one in felt_over_graph(scene, over != OVER[2])
            ]
            continue
        for loop, local in LOOPS.items():
            for delay in delays:
                directions = felt(with_loop(scene, local), delay=delay)
                rows += [Row(scene.name, loop, delay, one) for one in directions]
    return Transparency(tuple(rows))


def _percent(share: float) -> str:
    return f"{100.0 * share:.1f} %"
