# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What each of several users does to the others: F_j, its part of F_c, and X_ij."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from hapticmech_ros.experiment.figure_style import (
    AXIS_COLOURS,
    BLACK,
    GREEN,
    GREY,
    ORANGE,
    PURPLE,
    SKY,
    SMALL,
    TEXT,
    TIME_LABEL,
    about,
    at_least,
    at_rate,
    dress,
    new_figure,
)
from hapticmech_ros.experiment.figure_users import COLUMN, axes_of, mark_switches
from hapticmech_ros.experiment.shared_record import SharedRecord
from hapticmech_ros.scene import Scene

CAPTION = (
    "What each user does to the others, at the points held, axes of the world. Top: force of the "
    "others' hands on the mechanism, $F_j$, and what of it the user feels, $F_c$. Middle: "
    "acceleration of the user's point by the others, $X_{ij}F_j$, and by its own hand, "
    "$X_{ii}F_i$. Bottom: largest and least acceleration per newton by others ($X_{ij}$) and by "
    "the own hand ($X_{ii}$). Dotted: a hand lets go or takes hold."
)
# Of the curves of each other user.
OTHERS = (PURPLE, GREEN, ORANGE, SKY)
DASHED: Final = "--"


def coupling_figure(record: SharedRecord, scene: Scene) -> Figure:
    """Return the figure: a column for each user, of what the others do to it."""
    count = len(record.users)
    figure = new_figure(COLUMN * count, 8.0, about([scene.name], at_rate(CAPTION, scene)))
    rows = figure.subplots(3, count, sharex=True, sharey="row", squeeze=False)
    for index, point in enumerate(record.points):
        force, acceleration, mobility = rows[:, index]
        others = [other for other in record.points if other != point]
        force.set_title(f"{' and '.join(others)} → {point}", fontsize=TEXT, pad=22.0)
        _forces(force, record, scene, index)
        _accelerations(acceleration, record, scene, index)
        _mobilities(mobility, record, scene, index)
        for axes in rows[:, index]:
            mark_switches(axes, record, scene, axes is force)
    for row, label in zip(
        rows, ("force (N)", "acceleration (m/s²)", "acceleration per force (1/kg)"), strict=True
    ):
        for place, axes in enumerate(row):
            dress(axes, "", "" if place else label)
            at_least(axes)
    for axes in rows[-1]:
        axes.set_xlabel(TIME_LABEL, fontsize=TEXT)
    rows[-1, 0].set_ylim(bottom=0.0)
    rows[0, 0].set_xlim(record.times[0], record.times[-1])
    return figure


def _forces(axes: Axes, record: SharedRecord, scene: Scene, index: int) -> None:
    for row, name in axes_of(scene):
        colour = AXIS_COLOURS[name]
        axes.plot(record.times, record.felt[:, index, row], color=colour, linewidth=1.8)
        for place in _others(record, index):
            given = record.wrenches[:, place, row]
            axes.plot(record.times, given, color=colour, linewidth=1.2, linestyle=DASHED)
    axes.axhline(0.0, color=BLACK, linewidth=0.6, alpha=0.4, zorder=0)
    # Room for what the switches are.
    axes.margins(y=0.14)
    _legend(axes, scene, ("$F_c$", "$F_j$"))


def _accelerations(axes: Axes, record: SharedRecord, scene: Scene, index: int) -> None:
    found = record.accelerations(record.points[index])
    others = found[:, _others(record, index)].sum(axis=1)
    for row, name in axes_of(scene):
        colour = AXIS_COLOURS[name]
        axes.plot(record.times, others[:, row], color=colour, linewidth=1.8)
        own = found[:, index, row]
        axes.plot(record.times, own, color=colour, linewidth=1.2, linestyle=DASHED)
    axes.axhline(0.0, color=BLACK, linewidth=0.6, alpha=0.4, zorder=0)
    _legend(axes, scene, ("by others", "by the own hand"))


def _mobilities(axes: Axes, record: SharedRecord, scene: Scene, index: int) -> None:
    rows = [row for row, _ in axes_of(scene)]
    curves = [(index, GREY, f"{record.points[index]} itself")]
    curves += [
        (place, colour, f"by {record.points[place]}")
        for place, colour in zip(_others(record, index), OTHERS * len(record.users), strict=False)
    ]
    for place, colour, label in curves:
        blocks = record.coupling[:, index, place][:, rows][:, :, rows]
        sizes = np.linalg.svd(blocks, compute_uv=False)
        axes.plot(record.times, sizes[:, 0], color=colour, linewidth=1.8, label=label)
        axes.plot(record.times, sizes[:, -1], color=colour, linewidth=1.2, linestyle=DASHED)
    handles, labels = axes.get_legend_handles_labels()
    _place(axes, [*handles, *_styles()], [*labels, "largest", "least"])


def _others(record: SharedRecord, index: int) -> list[int]:
    return [place for place in range(len(record.users)) if place != index]


def _legend(axes: Axes, scene: Scene, styles: tuple[str, str]) -> None:
    """Add a legend of axes by colour, and of two styles of line."""
    named = axes_of(scene)
    colours = [Line2D([], [], color=AXIS_COLOURS[name]) for _, name in named]
    _place(axes, [*colours, *_styles()], [*(f"${name}$" for _, name in named), *styles])


def _styles() -> list[Line2D]:
    return [Line2D([], [], color=BLACK), Line2D([], [], color=BLACK, linestyle=DASHED)]


def _place(axes: Axes, handles: Sequence[Artist], labels: Sequence[str]) -> None:
    axes.legend(
        handles,
        labels,
        fontsize=SMALL,
        loc="lower left",
        bbox_to_anchor=(0.0, 1.0),
        ncols=len(labels),
        frameon=False,
        borderaxespad=0.2,
        handlelength=1.8,
        columnspacing=1.2,
    )
