"""The limits of a rendering as tables for a terminal."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import groupby

from rich.box import SIMPLE_HEAD
from rich.markup import escape
from rich.table import Table

from hapticmech_ros.bench.feel.limits.benchmark import Limits
from hapticmech_ros.bench.feel.limits.m_width import MPoint
from hapticmech_ros.bench.feel.limits.plan import Load
from hapticmech_ros.bench.feel.limits.z_width import ZPoint

NOTHING = "-"


def tables(limits: Limits) -> Iterator[Table]:
    """Yield a table for each kind of limit that was measured."""
    if limits.z:
        yield z_table(limits.z)
    if limits.m:
        yield m_table(limits.m)
    if limits.loads:
        yield load_table(limits.loads)


def z_table(points: Sequence[ZPoint]) -> Table:
    """Return the stiffest stable joint constraint at each rate, delay and hand, and its damping.

    Beside it: all dampings' stiffnesses over the eigenvalues', from the least to the largest ratio,
    and over the rule at little damping and where it is stiffest.
    """
    shown = _table("stiffest joint constraint that is stable")
    for name in ("Hz", "delay", "hand", "loop in", "K N/m", "B N s/m", "/ eigen", "/ rule"):
        shown.add_column(name, justify="right", no_wrap=True)
    for (scene, rate, delay, hand, loop), group in groupby(
        points, lambda one: (one.scene, one.rate_hz, one.delay, one.hand, one.loop)
    ):
        rows = list(group)
        best = max(rows, key=lambda one: one.measured or 0.0)
        seen = [ratio(one.measured, one.predicted) for one in rows]
        known = [one for one in seen if one is not None]
        shown.add_row(
            escape(scene),
            f"{rate:.0f}",
            str(delay),
            hand,
            loop,
            _number(best.measured, ".3g"),
            f"{best.damping:.3g}",
            f"{min(known):.2f} - {max(known):.2f}" if known else NOTHING,
            ", ".join(_number(ratio(one.measured, one.rule), ".2f") for one in (rows[0], best)),
        )
    return shown


def m_table(points: Sequence[MPoint]) -> Table:
    """Return the lightest and heaviest stable inertias, beside eigenvalues and the rule."""
    shown = _table("felt inertia that is stable, over the device's")
    for name in ("delay", "loop in", "hand", "own", "lightest", "eigen", "rule", "heaviest"):
        shown.add_column(name, justify="right", no_wrap=True)
    for one in points:
        shown.add_row(
            escape(one.scene),
            str(one.delay),
            "device" if one.local else "controller",
            "the scene's" if one.hand == "scene" else f"{one.share:.2f} m_d",
            f"{one.own:.2f}",
            _number(one.measured, ".3f"),
            _number(one.predicted, ".3f"),
            _number(one.rule, ".3f"),
            f"{one.heaviest:g}",
        )
    return shown


def load_table(loads: Sequence[Load]) -> Table:
    """Return penetration over F / k where it is farthest off, and what happened in experiments."""
    shown = _table("penetration, drift, contact, energy")
    heads = ("held", "depth k/F", "drift mm", "depth mm", "contact", "E_h mJ", "left mJ")
    for name in heads:
        shown.add_column(name, justify="right", no_wrap=True)
    for load in loads:
        seen = load.experience
        depths = [one.error / one.expected for one in load.yields if one.held]
        contact = seen.contact_error
        shown.add_row(
            escape(load.scene),
            str(len(depths)),
            f"{max(depths, key=lambda one: abs(one - 1.0)):.4f}" if depths else NOTHING,
            f"{1e3 * seen.drift_rms:.3f}" + ("" if seen.kept else " (lost)"),
            f"{1e3 * seen.penetration_rms:.3f}",
            NOTHING if contact is None else f"{100.0 * contact:.2g} %",
            f"{1e3 * seen.hand_energy:.3f}",
            f"{1e3 * seen.left_energy:.3f}",
        )
    return shown


def ratio(measured: float | None, predicted: float | None) -> float | None:
    """Return measured over predicted; None where one of them is not there."""
    return None if measured is None or not predicted else measured / predicted


def _number(value: float | None, style: str) -> str:
    return NOTHING if value is None else format(value, style)


def _table(title: str) -> Table:
    shown = Table(title=title, title_justify="left")
    shown.box = SIMPLE_HEAD
    shown.add_column("scene", no_wrap=True)
    return shown
