"""The comparison as a picture: error of what is free, stiffness of what is held, delay borne."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import MaxNLocator

from hapticmech_ros.bench.feel.comparison.ratio import FREQUENCIES_HZ
from hapticmech_ros.bench.feel.comparison.side_by_side import Column
from hapticmech_ros.bench.feel.comparison.variants import FREE, FULL, PROXY, SOFT, STIFF
from hapticmech_ros.experiment.figure_style import (
    BLUE,
    GREY,
    ORANGE,
    SKY,
    SMALL,
    VERMILION,
    dress,
    new_figure,
    save,
)

COLOURS = {FULL: BLUE, STIFF: SKY, FREE: GREY, PROXY: VERMILION, SOFT: ORANGE}
MARKS = {FULL: "o", STIFF: "s", FREE: "x", PROXY: "^", SOFT: "v"}
CAPTION = (
    "Left: error of felt impedance along free directions at 10 Hz, the worst of each. Middle: "
    "stiffness felt along what the joints hold, the softest. Right: periods of delay that sessions "
    "bear with these gains, of up to 50. 'Stiffest' gains leave a margin of 2 at the delay "
    "drawn; unstable is not drawn."
)
# Nothing smaller is told apart: 0.1 % and 1 N/m. Periods are drawn as they are.
LEAST = (1e-3, 1.0, None)
FREQUENCY_HZ = 10


def _error(row: Column) -> float:
    return row.errors[FREQUENCIES_HZ.index(FREQUENCY_HZ)]


def _stiffness(row: Column) -> float:
    return np.nan if row.softest_held is None else row.softest_held


def _borne(row: Column) -> float:
    return np.nan if row.largest_delay is None else row.largest_delay


VALUES: tuple[Callable[[Column], float], ...] = (_error, _stiffness, _borne)


def draw(columns: Sequence[Column], path: Path) -> Path:
    """Write the picture as PNG, and return its path: over scenes, or over delays of one scene."""
    scenes = list(dict.fromkeys(row.scene for row in columns))
    delays = sorted({row.delay for row in columns})
    over_delay = len(scenes) == 1 and len(delays) > 1
    height = 4.2 if over_delay else 1.6 + 0.34 * len(scenes)
    figure = new_figure(13.0, height, CAPTION)
    axes = figure.subplots(1, 3, sharey=not over_delay)
    shown = columns if over_delay else [row for row in columns if row.delay == delays[0]]
    for panel, least, value in zip(axes, LEAST, VALUES, strict=True):
        for name in COLOURS:
            rows = [row for row in shown if row.variant == name]
            values = [value(row) for row in rows]
            kept = [max(one, least) if least else float(one) for one in values]
            if over_delay:
                _line(panel, [row.delay for row in rows], kept, name)
            else:
                _dots(panel, [scenes.index(row.scene) for row in rows], kept, name)
        if least:
            panel.set_yscale("log") if over_delay else panel.set_xscale("log")
    labels = ("error at 10 Hz (1)", "stiffness held (N/m)", "delay borne (periods)")
    for panel, label in zip(axes, labels, strict=True):
        dress(panel, *(("delay (periods)", label) if over_delay else (label, "")))
    if over_delay:
        for panel in axes:
            panel.xaxis.set_major_locator(MaxNLocator(integer=True))
    else:
        axes[0].set_yticks(range(len(scenes)), scenes)
        axes[0].invert_yaxis()
    handles, names = axes[0].get_legend_handles_labels()
    figure.legend(
        handles,
        names,
        loc="outside upper left",
        fontsize=SMALL,
        ncols=len(names),
        frameon=False,
    )
    return save(figure, path)


def _dots(axes: Axes, rows: list[int], values: list[float], name: str) -> None:
    offset = 0.13 * (list(COLOURS).index(name) - 2)
    at = np.array(rows, dtype=float) + offset
    axes.plot(values, at, MARKS[name], color=COLOURS[name], markersize=6, label=name)


def _line(axes: Axes, delays: list[int], values: list[float], name: str) -> None:
    colour, mark = COLOURS[name], MARKS[name]
    axes.plot(delays, values, color=colour, marker=mark, linewidth=1.3, label=name)
