# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Figure of a study: every number that varies, over every key."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt
from matplotlib.figure import Figure

from hapticmech_ros.experiment.figure_style import BLUE, about, at_least, dress, new_figure
from hapticmech_ros.numerics import Array
from hapticmech_ros.study.task import with_unit

# Rows of panels at most: the numbers that come first, and vary.
MOST_ROWS = 6
# Of a number that varies more than so many times, the axis is logarithmic.
WIDE = 100.0
# A number that varies less is zero up to rounding, such as s of a rigid direction.
ROUNDING = 1e-12
CAPTION = (
    "Numbers of a study over the keys that were varied (SI units), one dot a scene; infinite ones, "
    "where a direction is rigid, are not drawn."
)


def study_figure(
    scene: str, values: Mapping[str, npt.NDArray[Any]], numbers: Mapping[str, Array]
) -> Figure:
    """Return the figure of a study.

    Args:
        scene: its name.
        values: (n,) of each key; texts are drawn in their order of appearance.
        numbers: (n,) measured, by name.
    """
    shown = [name for name, column in numbers.items() if _varies(column)][:MOST_ROWS]
    shown = shown or list(numbers)[:1]
    width, height = 1.0 + 3.4 * len(values), 0.6 + 2.0 * len(shown)
    figure = new_figure(max(width, 5.0), height, about([scene], CAPTION))
    panels = figure.subplots(len(shown), len(values), sharey="row", sharex="col", squeeze=False)
    for row, name in zip(panels, shown, strict=True):
        column = numbers[name]
        finite = np.isfinite(column)
        for axes, (key, value) in zip(row, values.items(), strict=True):
            axes.plot(value[finite], column[finite], ".", color=BLUE, markersize=3, alpha=0.6)
            if finite.any() and _is_wide(column[finite]):
                axes.set_yscale("log")
            at_least(axes)
            last, first = name == shown[-1], axes is row[0]
            dress(axes, key if last else "", with_unit(name) if first else "")
    return figure


def _varies(column: Array) -> bool:
    finite = column[np.isfinite(column)]
    return finite.size > 1 and bool(np.ptp(finite) > max(1e-9 * np.abs(finite).max(), ROUNDING))


def _is_wide(column: Array) -> bool:
    return bool(column.min() > 0.0 and column.max() > WIDE * column.min())
