"""The ablation's picture: parts of a tick, scene by scene, and what is not used beside it."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from matplotlib.axes import Axes

from hapticmech_ros.bench.ablation.findings import ERRORS, Rung, Unused
from hapticmech_ros.bench.ablation.loop import PARTS
from hapticmech_ros.experiment.figure_style import (
    BLACK,
    BLUE,
    GREEN,
    GREY,
    ORANGE,
    PURPLE,
    SKY,
    SMALL,
    TEXT,
    VERMILION,
    dress,
    legend,
    new_figure,
    save,
)

COLOURS = dict(zip(PARTS, (BLUE, GREEN, PURPLE, VERMILION, ORANGE), strict=True))
CAPTION = (
    "Left: a tick of the session; each scene has one feature more than the one above it. Bars are "
    "medians of the parts, the mark is the median of whole ticks, the line ends at their 99th "
    "percentile; numbers are times the first scene. Right: scenes with something that they do not "
    "use, less the same without it; lines are three standard errors."
)


def draw(rungs: Sequence[Rung], found: Sequence[Unused], path: Path) -> Path:
    """Draw ladder and pairs, write the picture as PNG, and return its path."""
    figure = new_figure(13.0, 0.42 * max(len(rungs), len(found)) + 1.4, CAPTION)
    left, right = figure.subplots(1, 2, width_ratios=(2.0, 1.0))
    _ladder(left, rungs)
    _pairs(right, found)
    return save(figure, path)


def _ladder(axes: Axes, rungs: Sequence[Rung]) -> None:
    for row, rung in enumerate(rungs):
        at = 0.0
        for part in PARTS:
            label = part if row == 0 else None
            axes.barh(row, rung.parts_us[part], 0.62, left=at, color=COLOURS[part], label=label)
            at += rung.parts_us[part]
        axes.plot((rung.median_us, rung.p99_us), (row, row), color=GREY, linewidth=1.2)
        axes.plot(rung.median_us, row, "|", color=BLACK, markersize=11)
        text = f" {rung.ratio:.2f}"
        axes.annotate(text, (rung.p99_us, row), va="center", fontsize=SMALL, color="#555555")
    axes.set_yticks(range(len(rungs)), [rung.name for rung in rungs])
    axes.invert_yaxis()
    dress(axes, "time (µs)", "")
    legend(axes, len(PARTS))


def _pairs(axes: Axes, found: Sequence[Unused]) -> None:
    for row, one in enumerate(found):
        axes.barh(row, one.increment_us, 0.62, color=ORANGE if one.costs else SKY)
        reach = ERRORS * one.error_us
        ends = (one.increment_us - reach, one.increment_us + reach)
        axes.plot(ends, (row, row), color=BLACK, linewidth=1.2)
    axes.axvline(0.0, color=GREY, linewidth=1.0)
    axes.set_yticks(range(len(found)), [one.name for one in found])
    axes.invert_yaxis()
    dress(axes, "difference of a tick (µs)", "")
    axes.set_title("not used", fontsize=TEXT, loc="left")
