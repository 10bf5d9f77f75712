"""Common style of the figures; matplotlib's global state is not changed."""

from __future__ import annotations

import textwrap
from pathlib import Path

from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine

from hapticmech_ros.experiment.record import ExperimentRecord
from hapticmech_ros.experiment.summary import count_changes

# Okabe and Ito's colours, distinguishable with colour vision deficiencies.
BLUE, VERMILION, GREEN, PURPLE = "#0072B2", "#D55E00", "#009E73", "#CC79A7"
ORANGE, SKY, BLACK, GREY = "#E69F00", "#56B4E9", "#000000", "#8C8C8C"
AXIS_COLOURS = {"x": BLUE, "y": VERMILION, "z": GREEN}

DPI = 150
TEXT = 11.0
SMALL = 9.5
TIME_LABEL = "time since the hand started to push (s)"

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


def mark_changes(axes: Axes, record: ExperimentRecord, label: bool = False) -> None:
    """Draw a dotted vertical line where the constraint count changes, annotated if ``label``."""
    for change in count_changes(record):
        axes.axvline(change["time_s"], color=GREY, linestyle=":", linewidth=1.2, zorder=1)
        if label:
            axes.annotate(
                f"{change['from']} → {change['to']} at {change['time_s']:.2f} s",
                (change["time_s"], 1.0),
                xycoords=("data", "axes fraction"),
                xytext=(4, -1),
                textcoords="offset points",
                bbox={"facecolor": "white", "edgecolor": "none", "pad": 1.0, "alpha": 0.85},
                va="top",
                fontsize=SMALL,
                color="#555555",
            )


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


def save(figure: Figure, path: Path) -> Path:
    """Write a figure as PNG.

    Returns:
        Its path.
    """
    figure.savefig(path, format="png", metadata={"Software": None})
    return path
