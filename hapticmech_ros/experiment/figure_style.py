# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Common style of the figures; matplotlib's global state is not changed."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence
from pathlib import Path

from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine

from hapticmech_ros.experiment.record import ExperimentRecord
from hapticmech_ros.experiment.summary import count_changes
from hapticmech_ros.loading import load_scene
from hapticmech_ros.scene import Scene

# Okabe and Ito's colours, distinguishable with colour vision deficiencies.
BLUE, VERMILION, GREEN, PURPLE = "#0072B2", "#D55E00", "#009E73", "#CC79A7"
ORANGE, SKY, BLACK, GREY = "#E69F00", "#56B4E9", "#000000", "#8C8C8C"
AXIS_COLOURS = {"x": BLUE, "y": VERMILION, "z": GREEN}

DPI = 150
TEXT = 11.0
SMALL = 9.5
TIME_LABEL = "time since the first push (s)"

# The scene whose results are the paper's Fig. 5.
PAPER = "five_bar"
# Its keys that define that experiment: not its rate, device and gains, which a laboratory chooses.
EXPERIMENT = ("links", "closures", "operational_points", "initial_state", "hand")
# More scenes than this are shown as their number.
NAMES_SHOWN = 3
# Smallest span of axes, in their units, N, N mm, mm or degrees: less is rounding.
LEAST_SPAN = 1e-6
# Of a logarithmic axis, its end over its beginning.
LEAST_RATIO = 1.1
# Width of a label of a change as a share of the axes, rows of them, and the height of a row.
_LABEL_SHARE, _LABEL_ROWS, _LABEL_POINTS, _ROW_SHARE = 0.2, 3, 13.0, 0.1

# Width of an average character of the caption, and height of its lines, in inches.
_CHARACTER, _LINE = 0.0735, 0.19


def new_figure(width: float, height: float, caption: str) -> Figure:
    """Return an empty figure of ``width`` by ``height`` inches with a caption below it."""
    lines = textwrap.wrap(caption, int((width - 0.3) / _CHARACTER))
    foot = _LINE * len(lines) + 0.15
    total = height + foot
    engine = ConstrainedLayoutEngine(
        w_pad=0.08, h_pad=0.08, rect=(0.0, foot / total, 1.0, height / total)
    )
    figure = Figure(figsize=(width, total), dpi=DPI, layout=engine)
    FigureCanvasAgg(figure)
    figure.text(
        0.15 / width,
        (foot - 0.05) / total,
        "\n".join(lines),
        fontsize=TEXT - 0.5,
        va="top",
        linespacing=1.25,
    )
    return figure


def dress(axes: Axes, x_label: str, y_label: str) -> None:
    """Set labels, ticks and a light grid of axes."""
    axes.set_xlabel(x_label, fontsize=TEXT)
    axes.set_ylabel(y_label, fontsize=TEXT)
    axes.tick_params(labelsize=SMALL)
    axes.grid(True, color="#E3E3E3", linewidth=0.6)
    axes.set_axisbelow(True)
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)


def titled(scene: Scene, figure: str, caption: str, record: ExperimentRecord) -> str:
    """Return a caption that begins with its scene, or with the paper's figure if it is that.

    The point is named where the scene has several. It ends with the control rate.
    """
    paper = load_scene(PAPER)
    same = all(getattr(scene, key) == getattr(paper, key) for key in ("name", *EXPERIMENT))
    at = f", {record.point}" if len(scene.operational_points) > 1 else ""
    return f"{figure if same else scene.name + at}. {at_rate(caption, scene, record)}"


def at_rate(caption: str, scene: Scene, record: ExperimentRecord) -> str:
    """Return a caption that ends with the control rate, and a note if in lockstep."""
    lockstep = ", in lockstep" if record.lockstep else ""
    return f"{caption} Control rate {1.0 / scene.simulation.period:g} Hz{lockstep}."


def about(scenes: Sequence[str], caption: str) -> str:
    """Return a caption that begins with the scenes it is about."""
    names = list(dict.fromkeys(scenes))
    return f"{', '.join(names) if len(names) <= NAMES_SHOWN else f'{len(names)} scenes'}. {caption}"


def at_least(axes: Axes, names: str = "y", span: float = LEAST_SPAN) -> None:
    """Widen axes that would otherwise be filled by rounding errors.

    Args:
        axes: to widen; their centre stays.
        names: of the axes, x, y or both.
        span: smallest one of a linear axis, in its unit.
    """
    for name in names:
        low, high = getattr(axes, f"get_{name}lim")()
        if getattr(axes, f"get_{name}scale")() == "log":
            middle, half = (low * high) ** 0.5, LEAST_RATIO**0.5
            wider = (middle / half, middle * half) if high < LEAST_RATIO * low else None
        else:
            middle, half = 0.5 * (low + high), 0.5 * span
            wider = (middle - half, middle + half) if high - low < span else None
        if wider is not None:
            getattr(axes, f"set_{name}lim")(*wider)


def mark_changes(axes: Axes, record: ExperimentRecord, label: bool = False) -> None:
    """Draw a dotted vertical line where the constraint count changes.

    With ``label`` each is annotated above the plot, in as many rows as are needed; changes for
    whose labels there is no room have a line alone.
    """
    ends: list[float] = []
    duration = max(float(record.times[-1] - record.times[0]), record.period)
    for change in count_changes(record):
        axes.axvline(change["time_s"], color=GREY, linestyle=":", linewidth=1.2, zorder=1)
        at = (change["time_s"] - float(record.times[0])) / duration
        row = next((index for index, end in enumerate(ends) if end <= at), len(ends))
        if label and row < _LABEL_ROWS:
            ends[row : row + 1] = [at + _LABEL_SHARE]
            axes.annotate(
                f"{change['from']} → {change['to']} at {change['time_s']:.2f} s",
                (change["time_s"], 1.0),
                xycoords=("data", "axes fraction"),
                xytext=(4, -1 - _LABEL_POINTS * row),
                textcoords="offset points",
                bbox={"facecolor": "white", "edgecolor": "none", "pad": 1.0, "alpha": 0.85},
                va="top",
                fontsize=SMALL,
                color="#555555",
            )
    if len(ends) > 1:
        low, high = axes.get_ylim()
        axes.set_ylim(low, high + _ROW_SHARE * (len(ends) - 1) * (high - low))


def legend(axes: Axes, columns: int) -> None:
    """Add a legend above the axes."""
    axes.legend(
        fontsize=SMALL,
        loc="lower left",
        bbox_to_anchor=(0.0, 1.0),
        ncols=columns,
        frameon=False,
        borderaxespad=0.2,
        handlelength=2.4,
    )


def legend_outside(
    figure: Figure, lines: Sequence[Artist], names: Sequence[str], columns: int
) -> None:
    """Add one legend for all axes, above them."""
    figure.legend(
        lines, names, loc="outside upper left", ncols=columns, fontsize=SMALL, frameon=False
    )


def save(figure: Figure, path: Path) -> Path:
    """Write a figure as PNG.

    Returns:
        Its path.
    """
    figure.savefig(path, format="png", metadata={"Software": None})
    return path
