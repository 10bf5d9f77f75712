# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Writes the plots of Fig. 5, and those of several users; draws Fig. 5a (count) and 5c (wrench).

Fig. 5b: trajectories of the hand on the device and of the operational point.

Motion, wrenches and count of several users, and their effects on each other: F_j, F_c, X_ij.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any, Final

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator

from hapticmech_ros.experiment.figure_style import (
    AXIS_COLOURS,
    BLACK,
    BLUE,
    GREEN,
    GREY,
    LEAST_SPAN,
    ORANGE,
    PURPLE,
    SKY,
    SMALL,
    TEXT,
    TIME_LABEL,
    VERMILION,
    about,
    at_least,
    at_rate,
    dress,
    legend,
    legend_outside,
    mark_changes,
    new_figure,
    save,
    titled,
)
from hapticmech_ros.experiment.record import ExperimentRecord, SharedRecord, grips_of
from hapticmech_ros.experiment.summary import count_changes, pose_errors
from hapticmech_ros.numerics import Array
from hapticmech_ros.scene import Scene
from hapticmech_ros.scene.mechanism import Closure, Link, LinkFrame
from hapticmech_ros.view.placement import Skeleton, skeleton

USERS_CAPTION = (
    "What each user does and feels, axes of the world: displacement of the hand on its device, "
    "force of the hand on it, force of the joint-constraint controller on the hand, and the number "
    "of joint constraints felt. Dotted: a hand lets go or takes hold."
)
MM = 1e3
# Of a run that is drawn behind another one.
BEHIND: dict[str, Any] = {"color": GREY, "linewidth": 4.0, "alpha": 0.45}
# Inches of a user's column.
COLUMN = 4.9


def users_figure(
    record: SharedRecord, scene: Scene, reference: SharedRecord | None = None
) -> Figure:
    """Return the figure: a column for each user; ``reference`` is drawn behind, in grey."""
    figure = new_figure(
        COLUMN * len(record.users),
        8.6,
        about([scene.name], at_rate(USERS_CAPTION, scene, record.first)),
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
    """Draw a dotted line where a hand lets go or takes hold; ``label`` names which."""
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
        drawn = {"color": AXIS_COLOURS[name], "linewidth": 1.7, "label": f"${name}$"}
        for run, style in ((reference, BEHIND), (user, drawn)):
            if run is not None:
                way = run.device_position - run.device_position[0]
                moved.plot(run.times, MM * way[:, index], **style)
                force.plot(run.times, run.hand_wrench[:, index], **style)
                constraint.plot(run.wrench_times, run.constraint_wrench[:, index], **style)
    if reference is not None:
        moved.get_lines()[0].set_label(f"reference ({reference.source})")
        count.step(reference.analysis_times, reference.count, where="post", **BEHIND)
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
    # Room for the labels of switches.
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
    """Return the figure: a column for each user, of the others' effects on it."""
    count = len(record.users)
    figure = new_figure(
        COLUMN * count, 8.0, about([scene.name], at_rate(COUPLING_CAPTION, scene, record.first))
    )
    rows = figure.subplots(3, count, sharex=True, sharey="row", squeeze=False)
    for index, point in enumerate(record.points):
        force, acceleration, mobility = rows[:, index]
        others = [place for place in range(count) if place != index]
        names = " and ".join(record.points[place] for place in others)
        force.set_title(f"{names} → {point}", fontsize=TEXT, pad=22.0)
        given = [record.wrenches[:, place] for place in others]
        _two_kinds(force, record.times, record.felt[:, index], given, scene, ("$F_c$", "$F_j$"))
        # Room for the labels of switches.
        force.margins(y=0.14)
        found = record.accelerations(point)
        by_others, own = found[:, others].sum(axis=1), found[:, index]
        styles = ("by others", "by the own hand")
        _two_kinds(acceleration, record.times, by_others, [own], scene, styles)
        _mobilities(mobility, record, scene, index, others)
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


def _two_kinds(
    axes: Axes,
    times: Array,
    solid: Array,
    dashed: Sequence[Array],
    scene: Scene,
    styles: tuple[str, str],
) -> None:
    """Draw vectors (k, 6) along the scene's axes, with a legend of these and of both styles."""
    named = axes_of(scene)
    for row, name in named:
        colour = AXIS_COLOURS[name]
        axes.plot(times, solid[:, row], color=colour, linewidth=1.8)
        for one in dashed:
            axes.plot(times, one[:, row], color=colour, linewidth=1.2, linestyle=DASHED)
    axes.axhline(0.0, color=BLACK, linewidth=0.6, alpha=0.4, zorder=0)
    colours = [Line2D([], [], color=AXIS_COLOURS[name]) for _, name in named]
    _place(axes, [*colours, *_styles()], [*(f"${name}$" for _, name in named), *styles])


def _mobilities(
    axes: Axes, record: SharedRecord, scene: Scene, index: int, others: Sequence[int]
) -> None:
    rows = [row for row, _ in axes_of(scene)]
    curves = [(index, GREY, f"{record.points[index]} itself")]
    curves += [
        (place, colour, f"by {record.points[place]}")
        for place, colour in zip(others, OTHERS * len(record.users), strict=False)
    ]
    for place, colour, label in curves:
        blocks = record.coupling[:, index, place][:, rows][:, :, rows]
        sizes = np.linalg.svd(blocks, compute_uv=False)
        axes.plot(record.times, sizes[:, 0], color=colour, linewidth=1.8, label=label)
        axes.plot(record.times, sizes[:, -1], color=colour, linewidth=1.2, linestyle=DASHED)
    handles, labels = axes.get_legend_handles_labels()
    _place(axes, [*handles, *_styles()], [*labels, "largest", "least"])


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


_SAME_PLACE = 1e-9


@dataclass(frozen=True, slots=True)
class TautCircle:
    """Centre (2,) in m, in the plane x-y of the world, and radius in m."""

    centre: Array
    radius: float


def taut_circle(scene: Scene, point: str = "") -> TautCircle | None:
    """Return the circle on which the chain from the operational point to a ground pin is stretched.

    It is defined for a planar scene in which a chain of pin-jointed links starts at the operational
    point and ends in a closure with the world; else None.
    """
    if scene.task_space != "planar":
        return None
    held = scene.operational_point(point)
    parents = {link.name: link for link in scene.links}
    for closure in scene.closures:
        ends = _ground_pin(closure)
        if ends is None:
            continue
        tip, ground = ends
        chain = _chain(parents, tip.link, held.link)
        if not chain or any(link.joint.type != "revolute" or link.joint.locked for link in chain):
            continue
        first = np.array(chain[0].joint.origin.xyz) - np.array(held.origin.xyz)
        if np.linalg.norm(first) > _SAME_PLACE:
            continue
        steps = [link.joint.origin.xyz for link in chain[1:]] + [tip.origin.xyz]
        radius = float(sum(np.linalg.norm(step) for step in steps))
        return TautCircle(np.array(ground.origin.xyz[:2]), radius)
    return None


def _ground_pin(closure: Closure) -> tuple[LinkFrame, LinkFrame] | None:
    """Return moving end and ground end of a pin to the world; None for other closures."""
    if closure.kind in ("weld", "rod"):
        return None
    for tip, ground in ((closure.a, closure.b), (closure.b, closure.a)):
        if ground.link == "world" and tip.link != "world":
            return tip, ground
    return None


def _chain(links: dict[str, Link], tip: str, root: str) -> list[Link]:
    """Return the links after ``root`` up to ``tip``; empty if ``tip`` does not descend from it."""
    chain: list[Link] = []
    name = tip
    while name != root:
        if name == "world":
            return []
        chain.append(links[name])
        name = links[name].parent
    return chain[::-1]


# Smallest span of a view, mm.
LEAST_VIEW = 1e-3
# The circle of reach is drawn if the point comes nearer to it than this share of its radius.
NEAR_REACH = 0.05
CAPTION = (
    "Trajectory of the user's hand on the haptic device and of the operational point in "
    "the simulation. The hand follows with an error due to the finite stiffness of the "
    "joint-constraint controller."
)
_NAMES = "xyz"


def trajectory_figure(
    record: ExperimentRecord, scene: Scene, reference: ExperimentRecord | None = None
) -> Figure:
    """Return the figure: a view of the plane x-y or three views of space, and errors over time.

    ``reference`` is drawn behind, in grey.
    """
    caption = titled(scene, "Fig. 5b", CAPTION, record)
    if scene.task_space == "planar":
        figure = new_figure(10.0, 6.2, caption)
        grid = figure.add_gridspec(2, 2, width_ratios=(1.45, 1.0))
        views = [(figure.add_subplot(grid[:, 0]), (0, 1))]
        close_up, error = figure.add_subplot(grid[0, 1]), figure.add_subplot(grid[1, 1])
        _close_up(close_up, record)
    else:
        figure = new_figure(11.0, 7.0, caption)
        grid = figure.add_gridspec(2, 3, height_ratios=(1.5, 1.0))
        planes = ((0, 1), (0, 2), (1, 2))
        views = [(figure.add_subplot(grid[0, i]), plane) for i, plane in enumerate(planes)]
        error = figure.add_subplot(grid[1, :])
    for axes, plane in views:
        _view(axes, record, scene, plane, reference)
    if scene.task_space == "planar":
        legend(views[0][0], 2)
    else:
        handles, labels = views[0][0].get_legend_handles_labels()
        legend_outside(figure, handles, labels, 4)
    _errors(error, record)
    return figure


def _view(
    axes: Axes,
    record: ExperimentRecord,
    scene: Scene,
    plane: tuple[int, int],
    reference: ExperimentRecord | None,
) -> None:
    """Draw trajectories and mechanism, projected on two axes of the world."""
    columns = list(plane)
    if record.joint_positions.shape[0]:
        first = skeleton(scene, record.joint_positions[0])
        last = skeleton(scene, record.joint_positions[-1])
        _mechanism(axes, first, columns, "mechanism at the start", "#C9C9C9", "--")
        _mechanism(axes, last, columns, "mechanism at the end", "#A8A8A8", "-")
    if scene.task_space == "planar":
        _taut(axes, record, scene)
    if reference is not None:
        path = MM * reference.device_position[:, columns]
        label = f"hand, reference ({reference.source})"
        axes.plot(path[:, 0], path[:, 1], color=GREY, linewidth=5.0, alpha=0.45, label=label)
    _paths(axes, record, columns)
    at_least(axes, "xy", LEAST_VIEW)
    axes.set_aspect("equal", adjustable="datalim")
    dress(axes, f"{_NAMES[plane[0]]} (mm)", f"{_NAMES[plane[1]]} (mm)")


def _paths(axes: Axes, record: ExperimentRecord, columns: list[int]) -> None:
    point, device = (
        MM * record.point_position[:, columns],
        MM * record.device_position[:, columns],
    )
    axes.plot(point[:, 0], point[:, 1], color=BLUE, linewidth=2.6, label="operational point")
    axes.plot(
        device[:, 0],
        device[:, 1],
        color=VERMILION,
        linewidth=1.5,
        linestyle=(0, (5, 2)),
        label="hand on the device",
    )
    # Where both are at one place the end stands in the ring of the start.
    ring: dict[str, Any] = {"markersize": 12, "fillstyle": "none", "markeredgewidth": 2.0}
    axes.plot(*device[0], "o", color=GREEN, zorder=5, label="start", **ring)
    axes.plot(*device[-1], "s", color=PURPLE, markersize=5, zorder=5, label="end")


def _mechanism(
    axes: Axes, drawing: Skeleton, columns: list[int], label: str, colour: str, style: str
) -> None:
    lines = [(ends, 2.2) for _, ends in drawing.links] + [(ends, 1.2) for ends in drawing.bars]
    for index, (ends, width) in enumerate(lines):
        line = MM * ends[:, columns]
        axes.plot(
            line[:, 0],
            line[:, 1],
            color=colour,
            linestyle=style,
            linewidth=width,
            solid_capstyle="round",
            zorder=1,
            label=label if index == 0 else None,
        )
    joints, ground = MM * drawing.joints[:, columns], MM * drawing.ground[:, columns]
    axes.plot(joints[:, 0], joints[:, 1], "o", color=colour, mfc="white", ms=5, zorder=1.5)
    axes.plot(ground[:, 0], ground[:, 1], "^", color="#666666", markersize=8, zorder=1.5)


def _taut(axes: Axes, record: ExperimentRecord, scene: Scene) -> None:
    """Draw the circle on which the links beyond the point are stretched, if the point is near."""
    circle = taut_circle(scene, record.point)
    if circle is None:
        return
    spokes = record.point_position[:, :2] - circle.centre
    near = np.abs(np.linalg.norm(spokes, axis=1) - circle.radius) < NEAR_REACH * circle.radius
    if not near.any():
        return
    spokes = spokes[near]
    middle = np.arctan2(*np.mean(spokes, axis=0)[::-1])
    offsets = np.arctan2(spokes[:, 1], spokes[:, 0]) - middle
    widest = float(np.abs(np.angle(np.exp(1j * offsets))).max()) + 0.12
    angles = middle + np.linspace(-widest, widest, 100)
    arc = circle.centre[:, None] + circle.radius * np.array((np.cos(angles), np.sin(angles)))
    axes.plot(
        MM * arc[0],
        MM * arc[1],
        color=BLACK,
        linestyle=":",
        linewidth=1.3,
        label="reach of the links to the ground pin",
    )


def _close_up(axes: Axes, record: ExperimentRecord) -> None:
    """Draw an enlarged view of the last change of the count, or of the largest error."""
    changes = count_changes(record)
    distance, _ = pose_errors(record)
    if changes:
        centre_index = int(np.searchsorted(record.times, changes[-1]["time_s"]))
        centre_index = min(centre_index, record.times.size - 1)
        title = "enlarged where the count changes"
    else:
        centre_index = int(np.argmax(distance))
        title = "enlarged where the error is largest"
    _paths(axes, record, [0, 1])
    _pairs(axes, record, centre_index)
    centre = MM * (record.device_position + record.point_position)[centre_index, :2] / 2.0
    half = max(7.0 * MM * float(distance.max()), 1e-3)
    axes.set_xlim(centre[0] - 1.6 * half, centre[0] + 1.6 * half)
    axes.set_ylim(centre[1] - half, centre[1] + half)
    axes.set_aspect("equal", adjustable="box")
    axes.xaxis.set_major_locator(MaxNLocator(5))
    axes.set_title(title, fontsize=TEXT, loc="left")
    dress(axes, "x (mm)", "y (mm)")


def _pairs(axes: Axes, record: ExperimentRecord, index: int) -> None:
    """Connect hand and operational point at equal times, every 25 ms around sample ``index``."""
    every = max(round(0.025 / record.period), 1)
    for i in range(max(index - 20 * every, 0), min(index + 20 * every, record.times.size), every):
        pair = MM * np.array((record.point_position[i], record.device_position[i]))
        axes.plot(pair[:, 0], pair[:, 1], color="#777777", linewidth=0.9, zorder=1.5)


def _errors(axes: Axes, record: ExperimentRecord) -> None:
    distance, angle = pose_errors(record)
    axes.plot(record.times, MM * distance, color=BLUE, linewidth=1.8, label="distance (mm)")
    axes.plot(
        record.times,
        np.degrees(angle),
        color=VERMILION,
        linewidth=1.5,
        linestyle="--",
        label="rotation (degrees)",
    )
    axes.set_xlim(record.times[0], record.times[-1])
    axes.set_ylim(0.0, max(axes.get_ylim()[1], LEAST_SPAN))
    dress(axes, TIME_LABEL, "error of the hand (mm, °)")
    mark_changes(axes, record)
    legend(axes, 2)


WRENCH_CAPTION = (
    "Virtual joint-constraint wrench on the user: by the joint-constraint controller, at "
    "the point held, axes of the world. Dashed: the wrench with which the joints balance the "
    "hand's push, from $\\Lambda_h^{-1}$ alone{less}. Dotted: the number of constraints changes. "
    "At the start springs come in over the engagement ramp."
)


EXPECTED: dict[str, Any] = {"color": BLACK, "linestyle": (0, (3, 3)), "linewidth": 1.1}


def wrench_figure(
    record: ExperimentRecord, scene: Scene, reference: ExperimentRecord | None = None
) -> Figure:
    """Return the figure; the norm of ``reference`` is drawn behind, in grey."""
    fed_forward = scene.controller.joint_constraint.feedforward > 0.0
    less = ", less the share that is fed forward" if fed_forward else ""
    caption = titled(scene, "Fig. 5c", WRENCH_CAPTION.replace("{less}", less), record)
    figure = new_figure(8.0, 6.0, caption)
    top, bottom = figure.subplots(2, 1, sharex=True, height_ratios=(1.25, 1.0))
    torque = [(row, "xyz"[row - 3]) for row in scene.moving_rows if row >= 3]
    if reference is not None:
        times = reference.wrench_times
        norm = np.linalg.norm(reference.constraint_wrench[:, :3], axis=1)
        top.plot(times, norm, label=f"norm, reference ({reference.source})", **BEHIND)
    _components(top, record, axes_of(scene), "F", 1.0)
    norm, expected = (
        np.linalg.norm(wrenches[:, :3], axis=1)
        for wrenches in (record.constraint_wrench, record.expected_wrench)
    )
    top.plot(record.wrench_times, norm, color=PURPLE, linewidth=2.2, label="norm")
    top.plot(record.analysis_times, expected, **EXPECTED)
    _components(bottom, record, torque, "M", 1e3)
    dress(top, "", "force (N)")
    dress(bottom, TIME_LABEL, "torque (N mm)")
    for axes in (top, bottom):
        axes.get_lines()[-1].set_label("expected")
        axes.axhline(0.0, color="#BBBBBB", linewidth=0.8, zorder=0)
        axes.margins(y=0.14)
        at_least(axes)
        mark_changes(axes, record, label=axes is top)
        legend(axes, 6)
    top.set_xlim(record.times[0], record.times[-1])
    return figure


def _components(
    axes: Axes, record: ExperimentRecord, chosen: list[tuple[int, str]], letter: str, scale: float
) -> None:
    for index, name in chosen:
        axes.plot(
            record.wrench_times,
            scale * record.constraint_wrench[:, index],
            color=AXIS_COLOURS[name],
            linewidth=1.8,
            label=f"${letter}_{name}$",
        )
    for index, _ in chosen:
        axes.plot(record.analysis_times, scale * record.expected_wrench[:, index], **EXPECTED)


COUNT_CAPTION = (
    "Number of virtual joint constraints felt by the user (top), and s = √μ of every "
    "direction of the task space (bottom): 0 is rigid (drawn at the lower edge), 1 as free as the "
    "link alone."
)
# s below this is drawn at the lower edge; it is zero up to rounding.
LOWEST_S = 1e-3


def count_figure(
    record: ExperimentRecord, scene: Scene, reference: ExperimentRecord | None = None
) -> Figure:
    """Return the figure; ``reference`` is drawn behind, in grey."""
    figure = new_figure(8.0, 4.8, titled(scene, "Fig. 5a", COUNT_CAPTION, record))
    top, bottom = figure.subplots(2, 1, sharex=True, height_ratios=(1.1, 1.0))
    if reference is not None:
        label = f"reference ({reference.source})"
        top.step(reference.analysis_times, reference.count, where="post", label=label, **BEHIND)
    top.step(
        record.analysis_times,
        record.count,
        where="post",
        color=BLUE,
        linewidth=2.0,
        label=record.source,
    )
    highest = max(int(run.count.max()) for run in (record, reference) if run is not None)
    top.set_ylim(-0.15, highest + 0.6)
    top.set_yticks(range(highest + 1))
    dress(top, "", "joint constraints (1)")
    mark_changes(top, record, label=True)
    if reference is not None:
        legend(top, 2)
    for index in range(record.s.shape[1]):
        bottom.plot(
            record.analysis_times,
            np.maximum(record.s[:, index], LOWEST_S),
            color=BLUE,
            linewidth=1.4,
            alpha=0.9,
        )
    perception = scene.perception
    for threshold, name in (
        (perception.s_on, "constrained below"),
        (perception.s_off, "free above"),
    ):
        bottom.axhline(threshold, color=VERMILION, linestyle="--", linewidth=1.0)
        bottom.annotate(
            f"{name} {threshold:g}",
            (1.01, threshold),
            xycoords=("axes fraction", "data"),
            ha="left",
            va="top" if threshold == perception.s_on else "bottom",
            fontsize=SMALL,
            color=VERMILION,
        )
    bottom.set_yscale("log")
    bottom.set_ylim(0.8 * LOWEST_S, 1.5)
    dress(bottom, TIME_LABEL, "s of each direction (1)")
    mark_changes(bottom, record)
    bottom.set_xlim(record.times[0], record.times[-1])
    return figure


FIGURES = {
    "fig5a.png": count_figure,
    "fig5b.png": trajectory_figure,
    "fig5c.png": wrench_figure,
}
USERS, COUPLING = "users.png", "coupling.png"


def write_figures(
    record: ExperimentRecord,
    scene: Scene,
    out_dir: str | os.PathLike[str],
    reference: ExperimentRecord | None = None,
) -> list[Path]:
    """Write ``fig5a.png``, ``fig5b.png`` and ``fig5c.png`` into ``out_dir``.

    Args:
        record: the run.
        scene: of the run.
        out_dir: existing folder; files of the same names are replaced.
        reference: a run to draw behind this one, in grey.

    Returns:
        Paths of the figures.
    """
    folder = Path(out_dir)
    return [save(draw(record, scene, reference), folder / name) for name, draw in FIGURES.items()]


def write_shared_figures(
    record: SharedRecord,
    scene: Scene,
    out_dir: str | os.PathLike[str],
    reference: SharedRecord | None = None,
) -> list[Path]:
    """Write ``users.png`` and ``coupling.png``, and each user's figures into a folder of its own.

    Args:
        record: the run.
        scene: of the run.
        out_dir: existing folder; files of the same names are replaced.
        reference: a run to draw behind this one, in grey.

    Returns:
        Paths of the figures.
    """
    folder = Path(out_dir)
    paths = [
        save(users_figure(record, scene, reference), folder / USERS),
        save(coupling_figure(record, scene), folder / COUPLING),
    ]
    for point, user in record.users.items():
        (folder / point).mkdir(exist_ok=True)
        behind = None if reference is None else reference.users[point]
        paths += write_figures(user, scene.held_at(point), folder / point, behind)
    return paths
