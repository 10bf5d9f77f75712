"""The feel of scenes as a picture: size and phase of felt over desired impedance."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from hapticmech_ros.bench.feel.row import Row
from hapticmech_ros.experiment.figure_style import BLUE, GREY, ORANGE, dress, new_figure, save

CAPTION = (
    "Felt over desired impedance along each free direction of each scene, at the smallest delay. "
    "Blue: the device corrects commands by what the hand has done since. Orange: it does not. "
    "Lines: measured. Circles: predicted by the model. Dotted: 3 dB."
)
CIRCLES = {"marker": "o", "markersize": 4.0, "fillstyle": "none", "linestyle": "none"}


def draw(rows: Sequence[Row], path: Path) -> Path:
    """Write the picture as PNG, and return its path."""
    figure = new_figure(9.0, 4.0, CAPTION)
    sizes, phases = figure.subplots(1, 2)
    least = min((row.delay for row in rows), default=0)
    for row in rows:
        if row.delay != least:
            continue
        colour = BLUE if row.loop == "device" else ORANGE
        ways = (row.felt.ratio, {"linewidth": 1.0}), (row.felt.predicted, CIRCLES)
        for ratio, style in ways:
            for axes, values in (
                (sizes, 20.0 * np.log10(np.abs(ratio))),
                (phases, np.rad2deg(np.angle(ratio))),
            ):
                axes.semilogx(row.felt.frequencies, values, color=colour, alpha=0.7, **style)
    for level in (-3.0, 3.0):
        sizes.axhline(level, color=GREY, linestyle=":", linewidth=1.0)
    dress(sizes, "frequency (Hz)", "size (dB)")
    dress(phases, "frequency (Hz)", "phase (°)")
    return save(figure, path)
