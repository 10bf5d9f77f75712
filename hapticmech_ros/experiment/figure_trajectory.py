# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Fig. 5b: trajectories of the hand on the device and of the operational point."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from hapticmech_ros.arrays import Array
from hapticmech_ros.experiment.figure_style import (
    BLACK,
    BLUE,
    GREEN,
    GREY,
    LEAST_SPAN,
    PURPLE,
    TEXT,
    TIME_LABEL,
    VERMILION,
    at_least,
    dress,
    legend,
    legend_outside,
    mark_changes,
    new_figure,
    titled,
)
from hapticmech_ros.experiment.record import ExperimentRecord
from hapticmech_ros.experiment.summary import count_changes, pose_errors
from hapticmech_ros.scene import Scene
from hapticmech_ros.scene.mechanism import Closure, Link, LinkFrame
from hapticmech_ros.view.skeleton import Skeleton, skeleton

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


MM = 1e3
# What a view shows at least, mm.
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
    caption = titled(scene, "Fig. 5b", CAPTION, record.point)
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
    centre = MM * _middle(record, centre_index)
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


def _middle(record: ExperimentRecord, index: int) -> Array:
    return np.asarray((record.device_position[index, :2] + record.point_position[index, :2]) / 2.0)


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
