# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Stability limits of scenes: Z-width, M-width, penetration, and results of the experiment."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import groupby
from typing import ClassVar

from matplotlib.figure import Figure

from hapticmech_ros.analysis.directions import directions
from hapticmech_ros.analysis.experience import Experience, experience
from hapticmech_ros.analysis.limits_figure import m_width_figure, z_width_figure
from hapticmech_ros.analysis.m_width import MPoint, m_width
from hapticmech_ros.analysis.penetration import Yield, penetration
from hapticmech_ros.analysis.scene_variants import at_rate, of_first_user, with_loop
from hapticmech_ros.analysis.study import NOTHING, SharedResults, Sheet, Show, number, silent
from hapticmech_ros.analysis.touch import Setup
from hapticmech_ros.analysis.z_width import ZPoint, z_width
from hapticmech_ros.errors import HapticMechError, InvalidInputError
from hapticmech_ros.scene import Scene
from hapticmech_ros.workers import Lost, Workers, in_order

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
