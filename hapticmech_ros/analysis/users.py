# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Felt impedance of scenes with several users, the others' arms included."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import groupby
from typing import Any, ClassVar

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from hapticmech_ros.analysis.beside_others import FeltBesideOthers, felt_beside_others
from hapticmech_ros.analysis.study import Results, Sheet, Show, complex_parts, silent
from hapticmech_ros.arrays import Array
from hapticmech_ros.experiment.figure_style import (
    BLUE,
    GREY,
    ORANGE,
    SMALL,
    about,
    dress,
    legend_outside,
    new_figure,
)
from hapticmech_ros.scene import Scene

CAPTION = (
    "Impedance that a user's hand feels along each direction that the mechanism leaves free, "
    "beside the desired one: the mechanism with the others' arms on it."
)
TABLE_CAPTION = (
    "error: felt over desired impedance less 1, complex; arms: by how much the others' arms change "
    "what is felt"
)


@dataclass(frozen=True, slots=True)
class Row:
    """What a user feels along one direction.

    Attributes:
        scene: its name.
        period: s.
        felt: along the direction.
    """

    scene: str
    period: float
    felt: FeltBesideOthers

    def document(self) -> dict[str, object]:
        """Return the row as plain lists and numbers."""
        found = self.felt
        return {
            "scene": self.scene,
            "period": self.period,
            "point": found.point,
            "direction": found.direction.tolist(),
            "frequencies_hz": found.frequencies.tolist(),
            **complex_parts(found, ("ratio", "desired", "alone")),
            "error_to_10_hz": found.error(10.0),
        }


@dataclass(frozen=True)
class Users(Results):
    """Felt impedance of scenes with several users.

    Attributes:
        rows: one for each user and direction.
    """

    NAME: ClassVar[str] = "users"

    rows: tuple[Row, ...]

    def document(self) -> list[dict[str, object]]:
        """Return the rows as plain dictionaries."""
        return [row.document() for row in self.rows]

    def sheets(self) -> Iterator[Sheet]:
        """Yield a row for each scene, period and user, with the worst of its directions."""
        lines, headings = [], ("scene", "user at", "period, ms", "directions")
        hertz: tuple[str, ...] = ()
        for key, group in groupby(self.rows, lambda row: (row.scene, row.felt.point, row.period)):
            found = [row.felt for row in group]
            worst = np.max([np.abs(one.ratio - 1.0) for one in found], axis=0)
            hertz = tuple(f"{one:g} Hz" for one in found[0].frequencies)
            shares = [one.share for one in found]
            arms = f"{100.0 * np.min(shares):.0f} to {100.0 * np.max(shares):.0f} %"
            errors = (f"{100.0 * one:.2g} %" for one in worst)
            scene, point, period = key
            lines.append((scene, point, f"{1e3 * period:g}", str(len(found)), *errors, arms))
        yield Sheet(
            "error of felt impedance beside others, worst direction",
            (*headings, *hertz, "arms"),
            tuple(lines),
            ("user at",),
            TABLE_CAPTION,
        )

    def figures(self) -> Mapping[str, Figure]:
        """Return felt and desired impedance over frequency, a panel for each user."""
        users = list(dict.fromkeys((row.scene, row.felt.point) for row in self.rows))
        figure = new_figure(
            9.0, 1.2 + 2.6 * len(users), about([row.scene for row in self.rows], CAPTION)
        )
        panels = figure.subplots(len(users), 2, squeeze=False)
        for (size, phase), (scene, point) in zip(panels, users, strict=True):
            mine = [row for row in self.rows if (row.scene, row.felt.point) == (scene, point)]
            least = min(row.period for row in mine)
            for row in mine:
                if row.period == least:
                    _draw(size, phase, row.felt)
            dress(size, "frequency (Hz)", "impedance (dB, 0 is 1 N s/m)")
            dress(phase, "frequency (Hz)", "phase (°)")
            size.set_title(f"{scene}, user at {point}", fontsize=SMALL, loc="left")
        lines = panels[0][0].get_lines()[:3]
        legend_outside(figure, lines, ["desired", "mechanism alone", "felt"], 3)
        return {"users.png": figure}


def users(scenes: Sequence[Scene], show: Show = silent) -> Users:
    """Measure what every user of some scenes feels.

    Args:
        scenes: with several ``hands`` each.
        show: called with each scene.

    Returns:
        Felt impedance of every user along every free direction.

    Raises:
        InvalidInputError: as :func:`~hapticmech_ros.analysis.beside_others.felt_beside_others`.
    """
    rows: list[Row] = []
    for scene in scenes:
        for point in scene.held_points:
            show(f"{scene.name}, {point}: {scene.description}")
            found = felt_beside_others(scene, point)
            rows += [Row(scene.name, scene.simulation.period, one) for one in found]
    return Users(tuple(rows))


def _draw(size: Axes, phase: Axes, found: FeltBesideOthers) -> None:
    felt = found.ratio * found.desired
    ways: tuple[tuple[Array, str, dict[str, Any]], ...] = (
        (found.desired, BLUE, {"linewidth": 1.4, "alpha": 0.7}),
        (found.alone, GREY, {"linewidth": 0.9, "linestyle": "dotted"}),
        (felt, ORANGE, {"marker": "o", "markersize": 3.5, "linestyle": "none", "alpha": 0.8}),
    )
    for values, colour, style in ways:
        size.semilogx(found.frequencies, 20.0 * np.log10(np.abs(values)), color=colour, **style)
        phase.semilogx(found.frequencies, np.rad2deg(np.angle(values)), color=colour, **style)
