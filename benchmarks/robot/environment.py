# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What a hand feels of a known environment that an iiwa touches: which are measured, and a figure.

The mechanism is a carriage of 0.6 kg that slides along two axes, of which each is a free direction
of its own: the felt impedance along one is a number, as that of the environment.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from benchmarks.robot.felt_environment import FeltEnvironment, Loop
from benchmarks.robot.tasks import IIWA
from hapticmech_ros import load_scene
from hapticmech_ros.analysis.study import Sheet
from hapticmech_ros.analysis.transparency import CIRCLES
from hapticmech_ros.experiment.figure_style import (
    BLUE,
    ORANGE,
    VERMILION,
    dress,
    legend_outside,
    new_figure,
)
from hapticmech_ros.robot.law import Gains
from hapticmech_ros.robot.linear_environment import Impedance

CARRIAGE = Path(__file__).with_name("carriage.yaml")
ENVIRONMENTS: dict[str, Impedance] = {
    "spring": Impedance(300.0, 6.0),
    "mass, spring, damper": Impedance(300.0, 6.0, 0.3),
    "wall": Impedance(20e3, 400.0),
}
COLOURS = {"spring": BLUE, "mass, spring, damper": ORANGE, "wall": VERMILION}
DASHES = {"effort": "solid", "velocity": "dashed", "trajectory": "dotted", "position": "dashdot"}
# Further periods each way.
DELAYS = (0, 5)
# Of the law, 1/s, as of the felt wall.
RATE = 40.0
CAPTION = (
    "Felt over desired impedance of an environment through device, mechanism and robot. "
    "Circles: closed form of the linear loop."
)


def loop() -> Loop:
    """Return the carriage that leads an iiwa."""
    return Loop(load_scene(CARRIAGE), load_scene(IIWA), Gains(linear_rate=RATE, angular_rate=RATE))


def _outcome(one: FeltEnvironment) -> str:
    """Return how far the closed form is off, or why there is nothing to compare with."""
    if one.steady:
        return f"{one.model_error(10.0):.3f}" + ("" if one.stable else ", unstable")
    return "not steady" if one.stable else "unstable"


def environment_sheet(found: Sequence[FeltEnvironment]) -> Sheet:
    """Return the table of what was felt.

    Args:
        found: what was measured.
    """
    rows = [
        (
            one.environment,
            one.interface,
            str(one.delay),
            *(
                f"{abs(ratio):.2f}, {np.degrees(np.angle(ratio)):.0f}°" if one.steady else "-"
                for ratio in one.ratio[np.isin(one.frequencies, (1.0, 3.0, 10.0, 30.0))]
            ),
            _outcome(one),
        )
        for one in found
    ]
    return Sheet(
        "felt over desired impedance of what the robot touches",
        ("environment", "interface", "delay", "1 Hz", "3 Hz", "10 Hz", "30 Hz", "closed form off"),
        tuple(rows),
        ("interface",),
        "delay: further periods each way; closed form off: largest relative error to 10 Hz, or "
        "unstable by it; not steady: what had begun had not died away",
        kept=24,
    )


def environment_figure(found: Sequence[FeltEnvironment]) -> Figure:
    """Return magnitudes and phases over frequency, of motions that became steady.

    Args:
        found: what was measured.
    """
    figure = new_figure(9.0, 4.4, CAPTION)
    sizes, phases = figure.subplots(1, 2)
    lines: dict[str, Line2D] = {}
    for one in found:
        if not one.steady or one.delay:
            continue
        colour, dashes = COLOURS[one.environment], DASHES[one.interface]
        for ratio, style in ((one.ratio, {"linestyle": dashes}), (one.predicted, CIRCLES)):
            sizes.semilogx(
                one.frequencies, 20.0 * np.log10(np.abs(ratio)), color=colour, alpha=0.7, **style
            )
            (line,) = phases.semilogx(
                one.frequencies, np.degrees(np.angle(ratio)), color=colour, alpha=0.7, **style
            )
            if ratio is one.ratio:
                lines[f"{one.environment}; {one.interface}"] = line
    dress(sizes, "frequency (Hz)", "magnitude (dB)")
    dress(phases, "frequency (Hz)", "phase (°)")
    legend_outside(figure, list(lines.values()), list(lines), 3)
    return figure
