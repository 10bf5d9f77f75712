# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Figures of felt inertia and spectrum over a recording, or over one or two joints."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure

from hapticmech_ros.experiment.figure_style import (
    AXIS_COLOURS,
    BLUE,
    LEAST_RATIO,
    SMALL,
    VERMILION,
    about,
    at_least,
    dress,
    legend,
    new_figure,
)
from hapticmech_ros.numerics import Array
from hapticmech_ros.offline.analysis import AnalysedStates, FeltStates
from hapticmech_ros.offline.sweep import PrescribedJoint, SweptStates
from hapticmech_ros.scene import Scene

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
# Of a joint's coordinate, by its type; rad of all others.
UNITS = {"prismatic": "m"}
# s below this is drawn at the lower edge; it is zero up to rounding.
LOWEST_S = 1e-3


def analysis_figure(found: AnalysedStates, scene: Scene, largest: float = LARGEST_KG) -> Figure:
    """Return the figure of a recording of a scene."""
    title = about([scene.name], WHAT.format(largest=largest))
    label = "time since the first sample (s)"
    return _lines(found, found.count, found.times, label, title, largest)


def sweep_figure(
    found: SweptStates,
    prescribed: Sequence[PrescribedJoint],
    scene: Scene,
    largest: float = LARGEST_KG,
) -> Figure:
    """Return the figure of a sweep: lines over one joint, maps over the last two of several."""
    units = {link.joint.name: UNITS.get(link.joint.type, "rad") for link in scene.links}
    labels = [f"{one.joint} ({units.get(one.joint, 'rad')})" for one in prescribed]
    if len(prescribed) == 1:
        title = about([scene.name], WHAT.format(largest=largest))
        return _lines(found, found.count, found.places[:, 0], labels[0], title, largest)
    title = about([scene.name], WHERE.format(largest=largest))
    return _maps(found, prescribed, labels, title, largest)


def _lines(
    found: FeltStates,
    count: npt.NDArray[np.int64],
    over: Array,
    label: str,
    title: str,
    largest: float,
) -> Figure:
    figure = new_figure(8.0, 6.4, title)
    top, middle, bottom = figure.subplots(3, 1, sharex=True, height_ratios=(1.3, 1.2, 0.8))
    for axis, (name, colour) in enumerate(AXIS_COLOURS.items()):
        felt = _mass(found, axis, largest)
        if not np.isnan(felt).all():
            top.plot(over, felt, color=colour, linewidth=1.4, label=f"along {name}")
    if top.lines:
        top.set_yscale("log")
        at_least(top)
        legend(top, 3)
    dress(top, "", "mass felt (kg)")
    for direction in range(found.s.shape[1]):
        middle.plot(over, np.maximum(found.s[:, direction], LOWEST_S), color=BLUE, linewidth=1.2)
    middle.set_yscale("log")
    middle.set_ylim(0.8 * LOWEST_S, 1.5)
    dress(middle, "", "s (1)")
    bottom.step(over, count, where="post", color=VERMILION, linewidth=1.8)
    most = int(count.max(initial=0))
    bottom.set_ylim(-0.15, most + 0.6)
    bottom.set_yticks(range(most + 1))
    dress(bottom, label, "joint constraints (1)")
    return figure


def _maps(
    found: SweptStates,
    prescribed: Sequence[PrescribedJoint],
    labels: Sequence[str],
    title: str,
    largest: float,
) -> Figure:
    figure = new_figure(11.0, 4.0, title)
    rigid = found.s <= LOWEST_S
    smallest = np.where(rigid, np.inf, found.s).min(axis=1)
    smallest[np.isinf(smallest)] = np.nan
    shown = (
        ("mass along x (kg)", _mass(found, 0, largest)),
        ("mass along y (kg)", _mass(found, 1, largest)),
        ("smallest s (1)", smallest),
    )
    across, up = prescribed[-1], prescribed[-2]
    # Further joints are shown at their first place.
    kept = (found.grid[:, :-2] == found.grid[0, :-2]).all(axis=1)
    for axes, (what, values) in zip(figure.subplots(1, 3, sharey=True), shown, strict=True):
        grid = np.full((len(up.values), len(across.values)), np.nan)
        grid[found.grid[kept, -2], found.grid[kept, -1]] = values[kept]
        if np.isnan(grid).all():
            # There are no finite values for a colour scale.
            axes.set_title(f"{what}: rigid at all places", fontsize=SMALL)
        else:
            low, high = float(np.nanmin(grid)), float(np.nanmax(grid))
            scale = LogNorm(low, max(high, LEAST_RATIO * low))
            drawn = axes.pcolormesh(across.values, up.values, grid, norm=scale, shading="nearest")
            figure.colorbar(drawn, ax=axes, shrink=0.9)
            axes.set_title(what, fontsize=SMALL)
        dress(axes, labels[-1], labels[-2] if values is shown[0][1] else "")
    return figure


def _mass(found: FeltStates, axis: int, largest: float) -> Array:
    """Return 1 / X_ii (kg), NaN above ``largest``."""
    mobility = found.inverse_inertia[:, axis, axis]
    felt = np.full(mobility.size, np.nan)
    moves = mobility > 1.0 / largest
    felt[moves] = 1.0 / mobility[moves]
    return felt
