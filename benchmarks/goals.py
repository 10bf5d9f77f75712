# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Goals, and whether they are met."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Literal

from hapticmech_ros.analysis.study import NOTHING, Marked, Sheet

Outcome = Literal["pass", "FAIL", "not measured"]
STYLES: dict[Outcome, str] = {"pass": "green", "FAIL": "bold red", "not measured": "yellow"}


@dataclass(frozen=True, slots=True)
class Verdict:
    """A goal, what was measured, and whether that is good enough."""

    goal: str
    seen: str
    outcome: Outcome


def verdict(goal: str, seen: str, met: bool) -> Verdict:
    """Return the verdict on something that was measured."""
    return Verdict(goal, seen, "pass" if met else "FAIL")


def unknown(goal: str) -> Verdict:
    """Return the verdict on a goal that no run is about."""
    return Verdict(goal, NOTHING, "not measured")


def at_most(goal: str, value: float | None, limit: float, style: str) -> Verdict:
    """Return the verdict on a figure that is to be at most so large; None: not measured.

    Args:
        goal: in words.
        value: that was measured.
        limit: of it.
        style: how it is shown, such as ``{:.2f} x``.
    """
    return unknown(goal) if value is None else verdict(goal, style.format(value), value <= limit)


def goal_sheet(goals: Iterable[Verdict]) -> Sheet:
    """Return the goals and whether they are met."""
    rows = tuple((one.goal, one.seen, Marked(one.outcome, STYLES[one.outcome])) for one in goals)
    return Sheet("goals", ("goal", "measured", "outcome"), rows, ("measured", "outcome"))
