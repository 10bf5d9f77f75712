"""A picture of an analysed recording: felt inertia, spectrum and count over time."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from hapticmech_ros.experiment.figure_style import (
    AXIS_COLOURS,
    BLUE,
    SMALL,
    VERMILION,
    dress,
    legend,
    new_figure,
)
from hapticmech_ros.offline.analysis import AnalysedStates

CAPTION = (
    "Mass felt along each axis of the world, 1 / X_ii (top; none is drawn above {largest:g} kg, "
    "where a direction is next to rigid), s = √μ of every direction of the task space (middle: 0 "
    "is rigid, 1 as free as the link alone), and joint constraints felt (bottom)."
)
LARGEST_KG = 1e3
# s below this is drawn at the lower edge: zero but for rounding.
LOWEST_S = 1e-3


def analysis_figure(found: AnalysedStates, largest: float = LARGEST_KG) -> Figure:
    """Return the figure."""
    figure = new_figure(8.0, 6.4, CAPTION.format(largest=largest))
    top, middle, bottom = figure.subplots(3, 1, sharex=True, height_ratios=(1.3, 1.2, 0.8))
    for axis, (name, colour) in enumerate(AXIS_COLOURS.items()):
        mobility = found.inverse_inertia[:, axis, axis]
        felt = np.full(mobility.size, np.nan)
        moves = mobility > 1.0 / largest
        felt[moves] = 1.0 / mobility[moves]
        if moves.any():
            top.plot(found.times, felt, color=colour, linewidth=1.4, label=f"along {name}")
    if top.lines:
        top.set_yscale("log")
        legend(top, 3)
    dress(top, "", "mass felt (kg)")
    for direction in range(found.s.shape[1]):
        drawn = np.maximum(found.s[:, direction], LOWEST_S)
        middle.plot(found.times, drawn, color=BLUE, linewidth=1.2)
    middle.set_yscale("log")
    dress(middle, "", "s")
    bottom.step(found.times, found.count, where="post", color=VERMILION, linewidth=1.8)
    bottom.set_ylim(-0.15, int(found.count.max(initial=0)) + 0.6)
    dress(bottom, "time since the first sample (s)", "constraints")
    bottom.tick_params(labelsize=SMALL)
    return figure
