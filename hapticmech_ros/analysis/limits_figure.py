# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Figures of Z-width and M-width, measured and predicted."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from hapticmech_ros.analysis.m_width import MPoint
from hapticmech_ros.analysis.stability_rules import lightest_mass
from hapticmech_ros.analysis.z_width import ZPoint
from hapticmech_ros.arrays import Array
from hapticmech_ros.experiment.figure_style import (
    BLACK,
    BLUE,
    GREEN,
    GREY,
    ORANGE,
    PURPLE,
    SMALL,
    VERMILION,
    about,
    dress,
    new_figure,
)

Z_CAPTION = (
    "Stiffest stable joint constraint over damping, without a hand, closed by the "
    "controller or (crosses) in the device. Marks: sessions. "
    "Lines: eigenvalues of the loop. Dotted: the rule (b + B) / (T / 2 + t_d). Right: the same "
    "without units, m the device's mass along the constraint and τ = T / 2 + t_d; what little "
    "differs is the shortest delay."
)
# Marks of a group of the M-width are between 1 / APART and APART times their place.
APART = 1.25
M_CAPTION = (
    "Lightest felt inertia that is stable, over the mass of a hand fixed to the device, both "
    "over the device's. Marks: sessions, set apart sideways about the mass that they are of. Line: "
    "the rule m_a / (m_d + 2 m_a). Left of the dashed line: the scene's own hand, without mass."
)


def z_width_figure(points: Sequence[ZPoint]) -> Figure:
    """Return the Z-width of the first scene, with and without units."""
    figure = new_figure(12.0, 4.6, about([points[0].scene], Z_CAPTION))
    left, right = figure.subplots(1, 2)
    first = points[0].scene
    alone = [one for one in points if one.hand == "nobody" and one.scene == first]
    shown = [one for one in alone if one.loop == "controller"]
    groups = sorted({(one.delay, one.rate_hz) for one in shown}, key=latency, reverse=True)
    colours = colormaps["viridis"](np.linspace(0.0, 0.9, len(groups)))
    for colour, group in zip(colours, groups, strict=True):
        rows = [one for one in shown if (one.delay, one.rate_hz) == group]
        label = f"{group[0]} at {group[1]:.0f} Hz"
        tau = latency(group)
        dampings = np.array([one.damping for one in rows])
        scale = np.array([one.mass for one in rows]) / tau
        _walls(left, rows, dampings, np.ones(len(rows)), colour, label)
        _walls(right, rows, dampings / scale, scale / tau, colour, label)
        rules = [one.rule for one in rows]
        left.plot(dampings, rules, color=colour, linestyle=":", linewidth=1.0)
    near = [one for one in alone if one.loop == "device"]
    for delay, mark in zip(sorted({one.delay for one in near}), "x+", strict=False):
        rows = [one for one in near if one.delay == delay]
        walls = [np.nan if one.measured is None else one.measured for one in rows]
        label = f"{delay}, in the device"
        left.plot(
            [one.damping for one in rows], walls, mark, color=VERMILION, markersize=7, label=label
        )
    ends = np.array([0.0, 1.0])
    right.plot(ends, ends, color=GREY, linestyle=":", linewidth=1.2)
    right.set_ylim(0.0, 1.1)
    left.set_xscale("log")
    left.set_yscale("log")
    dress(left, "damping B (N s/m)", f"stiffness K of {first} (N/m)")
    dress(right, "B τ / m (1)", "K τ² / m (1)")
    handles, names = left.get_legend_handles_labels()
    figure.legend(
        handles,
        names,
        loc="outside right upper",
        fontsize=SMALL,
        frameon=False,
        title="delay, periods",
    )
    return figure


def latency(group: tuple[int, float]) -> float:
    """Return τ = T / 2 + t_d, s, of a delay in periods and a rate in Hz."""
    return (0.5 + group[0]) / group[1]


def _walls(
    axes: Axes, rows: Sequence[ZPoint], x: Array, unit: Array, colour: Array, label: str
) -> None:
    measured = np.array([np.nan if one.measured is None else one.measured for one in rows])
    predicted = np.array([np.nan if one.predicted is None else one.predicted for one in rows])
    axes.plot(x, measured / unit, "o", markersize=5, color=colour, label=label)
    axes.plot(x, predicted / unit, color=colour, linewidth=1.2)


def m_width_figure(points: Sequence[MPoint]) -> Figure:
    """Return the M-width of every scene."""
    figure = new_figure(8.5, 4.2, about([one.scene for one in points], M_CAPTION))
    axes = figure.subplots()
    shares = np.geomspace(0.15, 6.0, 60)
    rule = [lightest_mass(1.0, share) for share in shares]
    axes.plot(shares, rule, color=BLACK, linewidth=1.2, label="rule")
    alone = 0.1
    axes.axvline(0.13, color=GREY, linestyle="--", linewidth=1.0)
    scenes = list(dict.fromkeys(one.scene for one in points))
    few = (BLUE, VERMILION, GREEN, PURPLE, ORANGE)
    colours = few if len(scenes) <= len(few) else colormaps["tab20"](range(20))
    # Series that agree would hide each other.
    apart = iter(np.geomspace(1.0 / APART, APART, 2 * len(scenes)))
    for index, scene in enumerate(scenes):
        for local, mark in ((True, "o"), (False, "x")):
            sideways = next(apart)
            rows = [one for one in points if one.scene == scene and one.local is local]
            x = [sideways * (one.share or alone) for one in rows]
            y = [np.nan if one.measured is None else one.measured for one in rows]
            label = f"{scene}, loop in {'device' if local else 'controller'}"
            colour = colours[index % len(colours)]
            axes.plot(x, y, mark, markersize=6, fillstyle="none", color=colour, label=label)
    axes.set_xscale("log")
    axes.set_yscale("log")
    dress(axes, "mass of the hand / mass of the device (1)", "lightest felt / device inertia (1)")
    figure.legend(loc="outside right upper", fontsize=SMALL, frameon=False)
    return figure
