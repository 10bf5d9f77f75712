# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Paths through a UR5e's wrist, frictions and payloads: our law by its rule, others at their best.

Our law has what follows from the loop's delay and a payload of 1 kg: at the tool, or 0.1 m beyond.
Of each other law the best setting of the grid counts in each case by itself. What is left to choose
in our law's rule, the gain margin, was chosen on the paths of ``DESIGN`` alone.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from benchmarks.robot.laws import DAMPED, IMPEDANCE, OBSERVER, Setting, others, ours
from benchmarks.robot.tasks import wrist_path
from benchmarks.robot.trial import Stage
from hapticmech_ros.analysis.study import Sheet, Show
from hapticmech_ros.robot.mujoco_robot import Unmodelled

# rad, where joints begin and end; the first is that of the task.
PATHS = (
    ((0.0, -1.9, 1.9, -0.5, -0.6, 0.0), (0.4, -1.6, 1.7, -0.7, 0.6, 0.3)),
    ((0.3, -1.4, 1.5, -0.9, 0.5, -0.4), (-0.3, -1.7, 1.9, -0.6, -0.7, 0.2)),
    ((0.0, -1.6, 1.4, -0.3, -0.3, 0.2), (0.2, -1.4, 1.6, -1.0, 0.8, -0.5)),
    ((0.5, -2.0, 2.1, -1.0, -0.9, 0.5), (0.1, -1.8, 1.6, 0.0, 0.3, 0.0)),
)
# Numbers of the paths on which something was chosen.
DESIGN = (1, 3)
# m, from the tool along its z axis.
FAR = 0.1
# kg, N m s/rad, N m and m that no law knows; with the observer, and without it.
UNKNOWN = (
    Unmodelled(),
    Unmodelled(0.5, 0.5, 0.25),
    Unmodelled(0.5, 0.5, 1.0),
    Unmodelled(0.5, 0.5, 0.5, FAR),
    Unmodelled(1.0, 0.0, 0.5),
    Unmodelled(1.0, 0.0, 0.5, FAR),
    Unmodelled(1.0, 0.0, 0.0, FAR),
)
UNOBSERVED = (Unmodelled(0.5, 0.5, 0.5), Unmodelled(1.0, 0.0, 0.5))
LAWS = ("ours, payload at the tool", f"ours, {FAR:g} m beyond", IMPEDANCE, DAMPED)


@dataclass(frozen=True)
class Elsewhere:
    """Path errors of the laws in one case.

    Attributes:
        path: its number, from 1.
        unknown: what no law knows.
        observed: whether the laws have the observer.
        errors: of ``LAWS`` along the path, rms, mm; infinite: the robot was lost.
    """

    path: int
    unknown: Unmodelled
    observed: bool
    errors: tuple[float, ...]

    @property
    def ahead(self) -> bool:
        """Whether our law, for the payload that is farther away, has the least error."""
        return self.errors[1] < min(self.errors[2:])


def elsewhere(show: Show) -> Iterator[Elsewhere]:
    """Yield the path errors of the laws in all cases.

    Args:
        show: called with what was done.
    """
    for number, (start, end) in enumerate(PATHS, 1):
        task = wrist_path(np.array(start), np.array(end))
        own = [[ours(task, seen, beyond) for beyond in (0.0, FAR)] for seen in (False, True)]
        for observed, cases in ((True, UNKNOWN), (False, UNOBSERVED)):
            for unknown in cases:
                stage = Stage(task, unknown)
                errors = [stage.path_error(setting) for setting in own[observed]]
                rate = OBSERVER if observed else 0.0
                errors += [_best(stage, tried, rate) for tried in others().values()]
                show(f"wrist path {number}, {unknown}, observer {observed}: {errors} mm")
                yield Elsewhere(number, unknown, observed, tuple(errors))


def _best(stage: Stage, tried: list[Setting], observer: float) -> float:
    """Return the least error along a stage's path, mm."""
    best = float("inf")
    for setting in tried:
        best = min(best, stage.path_error(setting._replace(observer=observer), best))
    return best


def elsewhere_sheets(found: tuple[Elsewhere, ...]) -> Iterator[Sheet]:
    """Yield the tables, of the paths something was chosen on and of the others.

    Args:
        found: path errors.
    """
    for title, numbers in (("design set", True), ("other paths", False)):
        cases = [one for one in found if (one.path in DESIGN) is numbers]
        rows = [
            (
                str(one.path),
                "yes" if one.observed else "no",
                f"{one.unknown.payload:g}",
                f"{one.unknown.beyond:g}",
                f"{one.unknown.damping:g}",
                f"{one.unknown.friction:g}",
                *("lost" if error == float("inf") else f"{error:.3f}" for error in one.errors),
                "yes" if one.ahead else "no",
            )
            for one in cases
        ]
        yield Sheet(
            f"path error, rms, mm, {title}",
            (
                *("path", "observer", "payload, kg", "beyond, m", "damping", "friction"),
                *(*LAWS, "ahead"),
            ),
            tuple(rows),
            caption=f"ahead, {FAR:g} m beyond: {sum(one.ahead for one in cases)} of {len(cases)}",
        )
