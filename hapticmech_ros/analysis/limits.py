# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Stability limits of scenes: Z-width, M-width, penetration, and results of the experiment."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import groupby
from typing import ClassVar

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from hapticmech_ros.analysis.experience import Experience, experience
from hapticmech_ros.analysis.m_width import MPoint, m_width
from hapticmech_ros.analysis.penetration import Yield, directions, penetration
from hapticmech_ros.analysis.scene_variants import at_rate, of_first_user, with_loop
from hapticmech_ros.analysis.stability_rules import lightest_mass
from hapticmech_ros.analysis.study import NOTHING, SharedResults, Sheet, Show, number, silent
from hapticmech_ros.analysis.touch import Setup
from hapticmech_ros.analysis.z_width import ZPoint, z_width
from hapticmech_ros.arrays import Array
from hapticmech_ros.errors import HapticMechError, InvalidInputError
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
from hapticmech_ros.scene import Scene
from hapticmech_ros.workers import Lost, Workers, in_order

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


# Masses of hands fixed to the device, relative to the device's mass.
SHARES = (1.0 / 3.0, 1.0, 3.0)
WHAT = ("z", "m", "loads")


@dataclass(frozen=True, slots=True)
class Load:
    """Results of steady pushes and of the scene's own experiment.

    Attributes:
        scene: its name.
        delay: periods from measuring to acting.
        yields: displacements by a push along each direction; empty if the session failed.
        experience: results of the experiment.
    """

    scene: str
    delay: int
    yields: tuple[Yield, ...]
    experience: Experience


@dataclass(frozen=True, slots=True)
class Case:
    """One measurement.

    Attributes:
        what: ``z``, ``m`` or ``loads``.
        scene: to measure.
        delay: periods.
        hand: for ``z``, ``nobody`` or ``still``.
        share: for ``m``, mass of the hand over that of the device; None for the scene's hand.
    """

    what: str
    scene: Scene
    delay: int
    hand: str = "nobody"
    share: float | None = None

    def __str__(self) -> str:
        rate = f"{1.0 / self.scene.simulation.period:.0f} Hz"
        names = {"z": "Z-width", "m": "M-width", "loads": "loads"}
        return f"{names[self.what]} of {self.scene.name}, {rate}, {self.delay} periods of delay"


Found = ZPoint | MPoint | Load


def cases_of(
    scenes: Sequence[Scene],
    delays: Sequence[int],
    rates: Sequence[float],
    what: Sequence[str] = WHAT,
) -> list[Case]:
    """Return the measurements: each delay at a scene's own rate, and each rate with one period.

    Args:
        scenes: to measure.
        delays: periods from measuring to acting.
        rates: Hz, further rates for Z-widths.
        what: any of ``z``, ``m`` and ``loads``.

    Raises:
        InvalidInputError: a delay below 0, a rate below 10 Hz, or an unknown measurement.
    """
    for delay in delays:
        if delay < 0:
            raise InvalidInputError("delay", delay, "must be 0 or more periods")
    for name in what:
        if name not in WHAT:
            raise InvalidInputError("what", name, f"must be one of {', '.join(WHAT)}")
    cases = []
    for scene in map(of_first_user, scenes):
        hands = ["nobody", "still"] if "waypoints" in type(scene.hand).model_fields else ["nobody"]
        if "z" in what and directions(scene).held.size:
            late = with_loop(scene, False)
            own = [(late, delay) for delay in delays]
            others = [(at_rate(late, rate), 1) for rate in rates]
            kept = {(one.simulation.period, delay): one for one, delay in [*others, *own]}
            for (_, delay), one in kept.items():
                cases += [Case("z", one, delay, hand) for hand in hands]
            near = with_loop(scene, True)
            cases += [Case("z", near, delay) for delay in sorted({min(delays), max(delays)})]
        if "m" in what:
            shares = [*SHARES, *([None] if len(hands) > 1 else [])]
            cases += [Case("m", with_loop(scene, True), 1, share=share) for share in shares]
            cases.append(Case("m", with_loop(scene, False), 1, share=1.0))
        if "loads" in what:
            cases.append(Case("loads", scene, 1))
    return cases


def _measured(case: Case) -> list[Found]:
    """Carry out one measurement.

    Returns:
        Its results.

    Raises:
        HapticMechError: a scene that cannot run.
    """
    if case.what == "z":
        return list(z_width(case.scene, delay=case.delay, hand=case.hand))
    if case.what == "m":
        return [m_width(case.scene, delay=case.delay, share=case.share)]
    setup = Setup(case.scene, delay=case.delay)
    try:
        yields = tuple(penetration(setup))
    except HapticMechError:
        yields = ()
    return [Load(case.scene.name, case.delay, yields, experience(setup))]


@dataclass(frozen=True)
class Limits(SharedResults):
    """All results.

    Attributes:
        z_width: stiffest stable joint constraints.
        m_width: lightest and heaviest stable inertias.
        loads: penetration, and results of experiments.
    """

    NAME: ClassVar[str] = "limits"

    z_width: tuple[ZPoint, ...]
    m_width: tuple[MPoint, ...]
    loads: tuple[Load, ...]

    def sheets(self) -> Iterator[Sheet]:
        """Yield a table for each kind of measurement."""
        if self.z_width:
            yield _z_sheet(self.z_width)
        if self.m_width:
            yield _m_sheet(self.m_width)
        if self.loads:
            yield _load_sheet(self.loads)

    def figures(self) -> Mapping[str, Figure]:
        """Return Z-width of the first scene and M-width of all scenes, measured and predicted."""
        found = {}
        if self.z_width:
            found["z_width.png"] = z_width_figure(self.z_width)
        if self.m_width:
            found["m_width.png"] = m_width_figure(self.m_width)
        return found


def limits(cases: Sequence[Case], workers: Workers = 1, show: Show = silent) -> Limits:
    """Carry out all measurements.

    Args:
        cases: from :func:`cases_of`.
        workers: that share the cases; they do not affect the results.
        show: called after each case.

    Returns:
        Results of all cases.

    Raises:
        InvalidInputError: no process.
    """
    found: list[Found] = []
    lost: list[str] = []
    for case, some in zip(cases, in_order(_measured, cases, workers), strict=True):
        if isinstance(some, Lost):
            lost.append(str(some))
        else:
            found += some
        show(str(case))
    return Limits(
        tuple(one for one in found if isinstance(one, ZPoint)),
        tuple(one for one in found if isinstance(one, MPoint)),
        tuple(one for one in found if isinstance(one, Load)),
        lost=tuple(lost),
    )


def _z_sheet(points: Sequence[ZPoint]) -> Sheet:
    """Return the stiffest stable joint constraint at each rate, delay and hand, and its damping.

    Further columns: range of the ratio of measured to eigenvalue limit over all dampings, and ratio
    of measured limit to the rule at the smallest damping and at that of the stiffest constraint.
    """
    lines = []
    for (scene, rate, delay, hand, loop), group in groupby(
        points, lambda one: (one.scene, one.rate_hz, one.delay, one.hand, one.loop)
    ):
        rows = list(group)
        best = max(rows, key=lambda one: one.measured or 0.0)
        seen = [_ratio(one.measured, one.predicted) for one in rows]
        known = [one for one in seen if one is not None]
        lines.append(
            (
                *(scene, f"{rate:.0f}", str(delay), hand, loop),
                number(best.measured, ".3g"),
                f"{best.damping:.3g}",
                f"{min(known):.2f} - {max(known):.2f}" if known else NOTHING,
                ", ".join(number(_ratio(one.measured, one.rule), ".2f") for one in (rows[0], best)),
            )
        )
    headings = ("scene", "Hz", "delay", "hand", "loop in", "K N/m", "B N s/m", "/ eigen", "/ rule")
    return Sheet("stiffest stable joint constraint", headings, tuple(lines))


def _m_sheet(points: Sequence[MPoint]) -> Sheet:
    lines = tuple(
        (
            *(one.scene, str(one.delay), "device" if one.local else "controller"),
            "the scene's" if one.hand == "scene" else f"{one.share:.2f} m_d",
            f"{one.own:.2f}",
            *(number(value, ".3f") for value in (one.measured, one.predicted, one.rule)),
            f"{one.heaviest:g}",
        )
        for one in points
    )
    headings = ("delay", "loop in", "hand", "own", "lightest", "eigen", "rule", "heaviest")
    return Sheet("stable felt inertia over the device's inertia", ("scene", *headings), lines)


def _load_sheet(loads: Sequence[Load]) -> Sheet:
    """Return the penetration that deviates most from F / k, and results of the experiments."""
    lines = []
    for load in loads:
        seen = load.experience
        depths = [one.error / one.expected for one in load.yields if one.held]
        contact = seen.contact_error
        lines.append(
            (
                *(load.scene, str(len(depths))),
                f"{max(depths, key=lambda one: abs(one - 1.0)):.4f}" if depths else NOTHING,
                f"{1e3 * seen.drift_rms:.3f}" + ("" if seen.kept else " (lost)"),
                f"{1e3 * seen.penetration_rms:.3f}",
                NOTHING if contact is None else f"{100.0 * contact:.2g} %",
                f"{1e3 * seen.hand_energy:.3f}",
                f"{1e3 * seen.left_energy:.3f}",
            )
        )
    headings = ("constraints", "depth k/F", "drift mm", "depth mm", "contact", "E_h mJ", "rest mJ")
    return Sheet("penetration, drift, contact error, energy", ("scene", *headings), tuple(lines))


def _ratio(measured: float | None, predicted: float | None) -> float | None:
    return None if measured is None or not predicted else measured / predicted
