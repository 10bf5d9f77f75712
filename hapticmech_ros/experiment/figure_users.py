# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Motion, wrenches and count of several users, and what each does to the others: F_j, F_c, X_ij."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import Final

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from hapticmech_ros.arrays import Array
from hapticmech_ros.experiment.figure_style import (
    AXIS_COLOURS,
    BLACK,
    BLUE,
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
    legend,
    new_figure,
)
from hapticmech_ros.experiment.record import ExperimentRecord
from hapticmech_ros.experiment.shared_record import SharedRecord, grips_of
from hapticmech_ros.scene import Scene

USERS_CAPTION = (
    "What each user does and feels, axes of the world: displacement of the hand on its device, "
    "force of the hand on it, force of the joint-constraint controller on the hand, and the number "
    "of joint constraints felt. Dotted: a hand lets go or takes hold."
)
MM = 1e3
# Inches of a user's column.
COLUMN = 4.9


def users_figure(
    record: SharedRecord, scene: Scene, reference: SharedRecord | None = None
) -> Figure:
    """Return the figure: a column for each user; ``reference`` is drawn behind, in grey."""
    figure = new_figure(
        COLUMN * len(record.users), 8.6, about([scene.name], at_rate(USERS_CAPTION, scene))
    )
    rows = figure.subplots(
        4, len(record.users), sharex=True, sharey="row", squeeze=False, height_ratios=(3, 3, 3, 2)
    )
    for (point, user), column in zip(record.users.items(), rows.T, strict=True):
        behind = None if reference is None else reference.users[point]
        _user(column, user, behind, scene)
        column[0].set_title(point, fontsize=TEXT, pad=22.0)
        for axes in column:
            mark_switches(axes, record, scene, axes is column[0])
    for row in rows:
        for axes in row[1:]:
            axes.set_ylabel("")
    rows[0, 0].set_xlim(record.first.times[0], record.first.times[-1])
    return figure


def axes_of(scene: Scene) -> list[tuple[int, str]]:
    """Return column and name of each axis of a force in a scene."""
    return [(index, "xyz"[index]) for index in scene.moving_rows if index < 3]


def mark_switches(axes: Axes, record: SharedRecord, scene: Scene, label: bool = False) -> None:
    """Draw a dotted line where a hand lets go or takes hold; ``label`` says which."""
    for before, after in pairwise(grips_of(scene, float(record.first.times[-1]))):
        axes.axvline(after.begin, color=GREY, linestyle=":", linewidth=1.2, zorder=1)
        if label:
            released = [point for point in before.holding if point not in after.holding]
            taken = [point for point in after.holding if point not in before.holding]
            words = [f"{point} lets go" for point in released]
            words += [f"{point} takes hold" for point in taken]
            axes.annotate(
                ", ".join(words),
                (after.begin, 1.0),
                xycoords=("data", "axes fraction"),
                xytext=(4, -1),
                textcoords="offset points",
                bbox={"facecolor": "white", "edgecolor": "none", "pad": 1.0, "alpha": 0.85},
                va="top",
                fontsize=SMALL,
                color="#555555",
            )


def _user(
    column: Array, user: ExperimentRecord, reference: ExperimentRecord | None, scene: Scene
) -> None:
    moved, force, constraint, count = column
    for index, name in axes_of(scene):
        for run, style in ((reference, True), (user, False)):
            if run is None:
                continue
            drawn = (
                {"color": GREY, "linewidth": 4.0, "alpha": 0.45}
                if style
                else {"color": AXIS_COLOURS[name], "linewidth": 1.7, "label": f"${name}$"}
            )
            start = run.device_position[0]
            moved.plot(run.times, MM * (run.device_position - start)[:, index], **drawn)
            force.plot(run.times, run.hand_wrench[:, index], **drawn)
            constraint.plot(run.wrench_times, run.constraint_wrench[:, index], **drawn)
    if reference is not None:
        moved.get_lines()[0].set_label(f"reference ({reference.source})")
        count.step(
            reference.analysis_times,
            reference.count,
            where="post",
            color=GREY,
            linewidth=4.0,
            alpha=0.45,
        )
    count.step(user.analysis_times, user.count, where="post", color=BLUE, linewidth=2.0)
    highest = int(max(user.count.max(), *count.get_ylim()))
    count.set_ylim(-0.15, highest + 0.4)
    count.set_yticks(range(highest + 1))
    for axes, label in (
        (moved, "displacement (mm)"),
        (force, "hand's force (N)"),
        (constraint, "constraint force (N)"),
    ):
        dress(axes, "", label)
        axes.axhline(0.0, color=BLACK, linewidth=0.6, alpha=0.4, zorder=0)
        at_least(axes)
    dress(count, TIME_LABEL, "constraints (1)")
    # Room for what the switches are.
    moved.margins(y=0.14)
    legend(moved, 4)
    count.set_axisbelow(True)


COUPLING_CAPTION = (
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
    figure = new_figure(COLUMN * count, 8.0, about([scene.name], at_rate(COUPLING_CAPTION, scene)))
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
