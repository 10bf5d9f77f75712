# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The memory benchmark's picture: growth of each process over time."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from benchmarks.graph.report import PROCESS_COLOURS
from benchmarks.memory.growth import Watch
from hapticmech_ros.experiment.figure_style import BLUE, GREY, TEXT, dress, legend, new_figure

CAPTION = (
    "Resident size of each process, less what it was at the end of the warm-up (dotted line); the "
    "session over simulated time, nodes over time. Sizes go in pages of 4 KiB."
)


def drawn(watches: Mapping[str, Watch], warm_up: float) -> Figure:
    """Return a figure with a panel for each watch."""
    figure = new_figure(5.5 * max(len(watches), 1), 3.6, CAPTION)
    panels = figure.subplots(1, max(len(watches), 1), squeeze=False)[0]
    for axes, (name, watch) in zip(panels, watches.items(), strict=False):
        _panel(axes, watch, warm_up)
        pad = 44 if len(watch.resident) > 1 else 6
        axes.set_title(name, fontsize=TEXT, loc="left", pad=pad)
    return figure


def _panel(axes: Axes, watch: Watch, warm_up: float) -> None:
    minutes = np.array(watch.times) / 60.0
    settled = warm_up * float(minutes[-1])
    begin = int(np.searchsorted(minutes, settled))
    for name, sizes in watch.resident.items():
        grown = (np.array(sizes) - sizes[begin]) / (1 << 10)
        colour = PROCESS_COLOURS.get(name, BLUE)
        axes.plot(minutes, grown, color=colour, linewidth=1.2, label=name)
    axes.axvline(settled, color=GREY, linestyle=":", linewidth=1.2)
    dress(axes, "time (min)", "growth (KiB)")
    # Growth that is worth a word, a megabyte, is seen; what starting takes is not to hide it.
    axes.set_ylim(-1024.0, 1024.0)
    if len(watch.resident) > 1:
        legend(axes, 2)
