"""Figures of felt inertia and spectrum over a recording, or over one or two joints."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure

from hapticmech_ros.arrays import Array
from hapticmech_ros.experiment.figure_style import (
    AXIS_COLOURS,
    BLUE,
    SMALL,
    VERMILION,
    dress,
    legend,
    new_figure,
)
from hapticmech_ros.offline.analysis import AnalysedStates, FeltStates
from hapticmech_ros.offline.sweep import PrescribedJoint, SweptStates

WHAT = (
    "Mass felt along each axis of the world, 1 / X_ii (top; none is drawn above {largest:g} kg, "
    "where a direction is next to rigid), s = √μ of every direction of the task space (middle: 0 "
    "is rigid and drawn at the lower edge, 1 as free as the link alone), and joint constraints "
    "felt (bottom)."
)
WHERE = (
    "Mass felt along x and y of the world, 1 / X_ii (kg, no more than {largest:g}), and the "
    "smallest s = √μ that is not rigid (right). White: the mechanism cannot come there."
)
LARGEST_KG = 1e3
# s below this is drawn at the lower edge; it is zero up to rounding.
LOWEST_S = 1e-3


def analysis_figure(found: AnalysedStates, largest: float = LARGEST_KG) -> Figure:
    """Return the figure of a recording."""
    return _lines(found, found.count, found.times, "time since the first sample (s)", largest)


def sweep_figure(
    found: SweptStates, prescribed: Sequence[PrescribedJoint], largest: float = LARGEST_KG
) -> Figure:
    """Return the figure of a sweep: lines over one joint, maps over the last two of several."""
    if len(prescribed) == 1:
        return _lines(found, found.count, found.places[:, 0], _label(prescribed[0]), largest)
    return _maps(found, prescribed, largest)


def _lines(
    found: FeltStates, count: npt.NDArray[np.int64], over: Array, label: str, largest: float
) -> Figure:
    figure = new_figure(8.0, 6.4, WHAT.format(largest=largest))
    top, middle, bottom = figure.subplots(3, 1, sharex=True, height_ratios=(1.3, 1.2, 0.8))
    for axis, (name, colour) in enumerate(AXIS_COLOURS.items()):
        felt = _mass(found, axis, largest)
        if not np.isnan(felt).all():
            top.plot(over, felt, color=colour, linewidth=1.4, label=f"along {name}")
    if top.lines:
        top.set_yscale("log")
        legend(top, 3)
    dress(top, "", "mass felt (kg)")
    for direction in range(found.s.shape[1]):
        middle.plot(over, np.maximum(found.s[:, direction], LOWEST_S), color=BLUE, linewidth=1.2)
    middle.set_yscale("log")
    dress(middle, "", "s")
    bottom.step(over, count, where="post", color=VERMILION, linewidth=1.8)
    most = int(count.max(initial=0))
    bottom.set_ylim(-0.15, most + 0.6)
    bottom.set_yticks(range(most + 1))
    dress(bottom, label, "constraints")
    return figure


def _maps(found: SweptStates, prescribed: Sequence[PrescribedJoint], largest: float) -> Figure:
    figure = new_figure(11.0, 4.0, WHERE.format(largest=largest))
    rigid = found.s <= LOWEST_S
    smallest = np.where(rigid, np.inf, found.s).min(axis=1)
    smallest[np.isinf(smallest)] = np.nan
    shown = (
        ("mass along x (kg)", _mass(found, 0, largest)),
        ("mass along y (kg)", _mass(found, 1, largest)),
        ("smallest s", smallest),
    )
    across, up = prescribed[-1], prescribed[-2]
    # Further joints are shown at their first place.
    kept = (found.grid[:, :-2] == found.grid[0, :-2]).all(axis=1)
    for axes, (title, values) in zip(figure.subplots(1, 3, sharey=True), shown, strict=True):
        grid = np.full((len(up.values), len(across.values)), np.nan)
        grid[found.grid[kept, -2], found.grid[kept, -1]] = values[kept]
        if np.isnan(grid).all():
            # There are no finite values for a colour scale.
            axes.set_title(f"{title}: rigid at all places", fontsize=SMALL)
        else:
            drawn = axes.pcolormesh(
                across.values, up.values, grid, norm=LogNorm(), shading="nearest"
            )
            figure.colorbar(drawn, ax=axes, shrink=0.9)
            axes.set_title(title, fontsize=SMALL)
        dress(axes, _label(across), _label(up) if values is shown[0][1] else "")
    return figure


def _label(prescribed: PrescribedJoint) -> str:
    return f"{prescribed.joint} (rad or m)"


def _mass(found: FeltStates, axis: int, largest: float) -> Array:
    """Return 1 / X_ii (kg), NaN above ``largest``."""
    mobility = found.inverse_inertia[:, axis, axis]
    felt = np.full(mobility.size, np.nan)
    moves = mobility > 1.0 / largest
    felt[moves] = 1.0 / mobility[moves]
    return felt
