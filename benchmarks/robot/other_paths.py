# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Paths through a UR5e's wrist, frictions and payloads that no setting was chosen for.

Settings of the laws are those chosen for the first path, and so were the gains that our law has
along rigid directions. Each law has the observer.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from benchmarks.robot.laws import OBSERVER, damped, impedance, ours
from benchmarks.robot.tasks import wrist_path
from benchmarks.robot.trial import Stage
from hapticmech_ros.analysis.study import Sheet, Show
from hapticmech_ros.errors import HapticMechError
from hapticmech_ros.robot.mujoco_robot import Unmodelled

# rad, where joints begin and end; the first is that of the task.
PATHS = (
    ((0.0, -1.9, 1.9, -0.5, -0.6, 0.0), (0.4, -1.6, 1.7, -0.7, 0.6, 0.3)),
    ((0.3, -1.4, 1.5, -0.9, 0.5, -0.4), (-0.3, -1.7, 1.9, -0.6, -0.7, 0.2)),
    ((0.0, -1.6, 1.4, -0.3, -0.3, 0.2), (0.2, -1.4, 1.6, -1.0, 0.8, -0.5)),
    ((0.5, -2.0, 2.1, -1.0, -0.9, 0.5), (0.1, -1.8, 1.6, 0.0, 0.3, 0.0)),
)
# kg, N m s/rad and N m that no law knows.
UNKNOWN = (
    Unmodelled(),
    Unmodelled(0.5, 0.5, 0.25),
    Unmodelled(0.5, 0.5, 0.5),
    Unmodelled(0.5, 0.5, 1.0),
    Unmodelled(1.0, 0.0, 0.5),
)
# As chosen for the UR5e as modelled, and disturbed.
MODELLED = ours(60.0, 0.2), impedance(10000.0, 30.0, 0.7), damped(80.0, 0.1)
DISTURBED = ours(120.0, 0.2), impedance(10000.0, 100.0, 1.0), damped(80.0, 0.1)


@dataclass(frozen=True)
class Elsewhere:
    """Path errors of the laws in one case.

    Attributes:
        path: its number.
        payload: kg.
        damping: N m s/rad.
        friction: N m.
        errors: of each law along the path, rms, mm; None: the robot was lost.
    """

    path: int
    payload: float
    damping: float
    friction: float
    errors: tuple[float | None, ...]


def elsewhere(show: Show, paths: int = len(PATHS)) -> tuple[Elsewhere, ...]:
    """Return the path errors of the laws in all cases.

    Args:
        show: called with what was done.
        paths: how many of the paths.
    """
    found = []
    for number, (start, end) in enumerate(PATHS[:paths]):
        task = wrist_path(np.array(start), np.array(end))
        for unknown in UNKNOWN:
            stage = Stage(task, unknown)
            errors: list[float | None] = []
            for setting in MODELLED if unknown == Unmodelled() else DISTURBED:
                try:
                    measured = stage.run(setting._replace(observer=OBSERVER))
                except HapticMechError:
                    errors.append(None)
                else:
                    errors.append(measured.path_rms_mm)
            added = unknown.payload, unknown.damping, unknown.friction
            found.append(Elsewhere(number + 1, *added, tuple(errors)))
            show(f"wrist path {number + 1}, {unknown}: {errors} mm")
    return tuple(found)


def elsewhere_sheet(found: tuple[Elsewhere, ...]) -> Sheet:
    """Return the table.

    Args:
        found: path errors.
    """
    rows = [
        (
            str(one.path),
            f"{one.payload:g}",
            f"{one.damping:g}",
            f"{one.friction:g}",
            *("lost" if error is None else f"{error:.3f}" for error in one.errors),
        )
        for one in found
    ]
    names = tuple(setting.name for setting in DISTURBED)
    return Sheet(
        "path error, rms, mm, where no setting was chosen",
        ("path", "payload, kg", "damping, N m s/rad", "friction, N m", *names),
        tuple(rows),
    )
