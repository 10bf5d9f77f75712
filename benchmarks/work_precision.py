# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Figures of error over CPU time, both logarithmic: a panel for each mechanism."""

from __future__ import annotations

from collections.abc import Mapping

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import NullFormatter

from hapticmech_ros.experiment.figure_style import TEXT, dress, new_figure

COLUMNS = 3
# A logarithm has no place for an error of zero.
SMALLEST = 1e-16
# Colour and mark, by label.
Looks = Mapping[str, tuple[str, str]]


def panels(
    titles: Mapping[str, str], looks: Looks, caption: str, face: str | None = None
) -> tuple[Figure, dict[str, Axes]]:
    """Return a figure, and its panels by name.

    Args:
        titles: of the panels, by name.
        looks: of the legend's entries.
        caption: below the figure.
        face: colour inside the marks; that of the line if None.
    """
    columns = max(1, min(COLUMNS, len(titles)))
    rows = max(1, -(-len(titles) // columns))
    figure = new_figure(4.2 * columns, 3.5 * rows, caption)
    places = figure.subplots(rows, columns, squeeze=False).ravel()
    for axes in places[len(titles) :]:
        axes.set_axis_off()
    for axes, title in zip(places, titles.values(), strict=False):
        axes.set_title(title, fontsize=TEXT, loc="left")
    handles = [
        Line2D([], [], color=colour, marker=mark, mfc=face or colour, label=label)
        for label, (colour, mark) in looks.items()
    ]
    if handles:
        figure.legend(
            handles=handles, loc="outside upper left", ncols=5, fontsize=TEXT, frameon=False
        )
    return figure, dict(zip(titles, places, strict=False))


def finish(axes: Axes, unit: str) -> None:
    """Give a panel its logarithmic axes and their labels; errors have a unit."""
    axes.set_xscale("log")
    axes.set_yscale("log")
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_minor_formatter(NullFormatter())
    dress(axes, "CPU time per simulated second (s)", f"error ({unit})")
