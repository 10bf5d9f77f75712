# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Writes the plots of Fig. 5, and those of several users; draws Fig. 5a (count) and 5c (wrench)."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from hapticmech_ros.arrays import Array
from hapticmech_ros.experiment.figure_style import (
    AXIS_COLOURS,
    BLACK,
    BLUE,
    GREY,
    PURPLE,
    SMALL,
    TIME_LABEL,
    VERMILION,
    at_least,
    dress,
    legend,
    mark_changes,
    new_figure,
    save,
    titled,
)
from hapticmech_ros.experiment.figure_trajectory import trajectory_figure
from hapticmech_ros.experiment.figure_users import coupling_figure, users_figure
from hapticmech_ros.experiment.record import ExperimentRecord
from hapticmech_ros.experiment.shared_record import SharedRecord
from hapticmech_ros.scene import Scene

WRENCH_CAPTION = (
    "Virtual joint-constraint wrench on the user: by the joint-constraint controller, at "
    "the point held, axes of the world. Dashed: the wrench with which the joints balance the "
    "hand's push, from $\\Lambda_h^{-1}$ alone{less}. Dotted: the number of constraints changes. "
    "At the start springs come in over the engagement ramp."
)


def wrench_figure(
    record: ExperimentRecord, scene: Scene, reference: ExperimentRecord | None = None
) -> Figure:
    """Return the figure; the norm of ``reference`` is drawn behind, in grey."""
    fed_forward = scene.controller.joint_constraint.feedforward > 0.0
    less = ", less the share that is fed forward" if fed_forward else ""
    caption = titled(scene, "Fig. 5c", WRENCH_CAPTION.replace("{less}", less), record.point)
    figure = new_figure(8.0, 6.0, caption)
    top, bottom = figure.subplots(2, 1, sharex=True, height_ratios=(1.25, 1.0))
    planar = scene.task_space == "planar"
    force = [(0, "x"), (1, "y")] if planar else [(0, "x"), (1, "y"), (2, "z")]
    torque = [(5, "z")] if planar else [(3, "x"), (4, "y"), (5, "z")]
    if reference is not None:
        times = reference.wrench_times
        norm = np.linalg.norm(reference.constraint_wrench[:, :3], axis=1)
        style = {"color": GREY, "linewidth": 4.0, "alpha": 0.45}
        top.plot(times, norm, label=f"norm, reference ({reference.source})", **style)
    _components(top, record, force, "F", 1.0)
    _norm(top, record)
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
        _expected(axes, record.analysis_times, scale * record.expected_wrench[:, index])


def _norm(axes: Axes, record: ExperimentRecord) -> None:
    norm = np.linalg.norm(record.constraint_wrench[:, :3], axis=1)
    axes.plot(record.wrench_times, norm, color=PURPLE, linewidth=2.2, label="norm")
    expected = np.linalg.norm(record.expected_wrench[:, :3], axis=1)
    _expected(axes, record.analysis_times, expected)


def _expected(axes: Axes, times: Array, values: Array) -> None:
    style = (0, (3, 3))
    axes.plot(times, values, color=BLACK, linestyle=style, linewidth=1.1)


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
    figure = new_figure(8.0, 4.8, titled(scene, "Fig. 5a", COUNT_CAPTION, record.point))
    top, bottom = figure.subplots(2, 1, sharex=True, height_ratios=(1.1, 1.0))
    if reference is not None:
        style = {"color": GREY, "linewidth": 4.0, "alpha": 0.45}
        label = f"reference ({reference.source})"
        top.step(reference.analysis_times, reference.count, where="post", label=label, **style)
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
