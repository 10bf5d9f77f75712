# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Fig. 5c: virtual joint-constraint wrench on the user, and its expected value."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from hapticmech_ros.arrays import Array
from hapticmech_ros.experiment.figure_style import (
    AXIS_COLOURS,
    BLACK,
    GREY,
    PURPLE,
    TIME_LABEL,
    at_least,
    dress,
    legend,
    mark_changes,
    new_figure,
    titled,
)
from hapticmech_ros.experiment.record import ExperimentRecord
from hapticmech_ros.scene import Scene

CAPTION = (
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
    caption = titled(scene, "Fig. 5c", CAPTION.replace("{less}", less), record.point)
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
