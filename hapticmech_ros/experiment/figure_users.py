# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Motion, wrenches and count of several users, beside each other."""

from __future__ import annotations

from itertools import pairwise

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from hapticmech_ros.arrays import Array
from hapticmech_ros.experiment.figure_style import (
    AXIS_COLOURS,
    BLACK,
    BLUE,
    GREY,
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
from hapticmech_ros.experiment.grips import grips_of
from hapticmech_ros.experiment.record import ExperimentRecord
from hapticmech_ros.experiment.shared_record import SharedRecord
from hapticmech_ros.scene import Scene

CAPTION = (
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
        COLUMN * len(record.users), 8.6, about([scene.name], at_rate(CAPTION, scene))
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
