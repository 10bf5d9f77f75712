# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Fig. 5a: number of virtual joint constraints over time, and the spectrum it is based on."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from hapticmech_ros.experiment.figure_style import (
    BLUE,
    GREY,
    SMALL,
    TIME_LABEL,
    VERMILION,
    dress,
    legend,
    mark_changes,
    new_figure,
    titled,
)
from hapticmech_ros.experiment.record import ExperimentRecord
from hapticmech_ros.scene import Scene

CAPTION = (
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
    figure = new_figure(8.0, 4.8, titled(scene, "Fig. 5a", CAPTION, record.point))
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
