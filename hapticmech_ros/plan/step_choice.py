# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Which integrator, in how many steps of a period, does a scene's experiment in the least time."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import get_args

import numpy as np

from hapticmech_ros.errors import HapticMechError, InvalidInputError
from hapticmech_ros.plan.step_accuracy import Runs, away, experiment_run
from hapticmech_ros.scene import Scene
from hapticmech_ros.scene.mechanism import IntegratorName
from hapticmech_ros.simulation import Simulator

# What others are compared with: twice, so that its own error is known.
REFERENCES: tuple[tuple[IntegratorName, int], ...] = (("tsit5", 16), ("rk4", 32))
# Share of a wanted error that the reference may be off by.
KNOWN = 0.1
# Steps of a period that are tried at most; periods that are timed, and how often.
MOST_SUBSTEPS, TIMED_PERIODS, REPEATS = 32, 100, 7


@dataclass(frozen=True, slots=True)
class StepChoice:
    """An integrator with so many steps of a period.

    Attributes:
        integrator: its name.
        substeps: steps of a period.
        error_m: largest distance of the operational point from the reference over the scene's
            experiment, and of its rotation times the mechanism's length.
        time_s: CPU time of the mechanism's steps in a period, median.
        failed: why it cannot do the experiment; empty if it can.
    """

    integrator: IntegratorName
    substeps: int
    error_m: float = float("inf")
    time_s: float = float("inf")
    failed: str = ""


@dataclass(frozen=True, slots=True)
class StepChoices:
    """What was tried for a scene.

    Attributes:
        wanted_m: the error that was asked for.
        reference_m: by which two references differ.
        tried: of each integrator the first number of steps that was accurate enough, or the last
            that was tried.
    """

    wanted_m: float
    reference_m: float
    tried: tuple[StepChoice, ...]

    @property
    def best(self) -> StepChoice | None:
        """What takes the least time of what is accurate enough; None if nothing is."""
        enough = [one for one in self.tried if one.error_m <= self.wanted_m]
        return min(enough, key=lambda one: one.time_s, default=None)


def step_choices(
    scene: Scene,
    wanted_m: float,
    clock: Callable[[], float],
    show: Callable[[str], None] = lambda text: None,
) -> StepChoices:
    """Try every integrator on a scene's experiment, in 1, 2, 4, ... steps of a period.

    Args:
        scene: whose experiment; its period is kept.
        wanted_m: largest error of the operational point, m.
        clock: CPU time, s.
        show: called with what is being tried.

    Returns:
        Errors and times of all, with the number of steps that each needs.

    Raises:
        InvalidInputError: an error that is not above 0.
        HapticMechError: a reference cannot do the experiment, or the two differ by more than a
            tenth of the error.
    """
    if not 0.0 < wanted_m < np.inf:
        raise InvalidInputError("error", wanted_m, "must be above 0 m")
    show("reference")
    found = [
        experiment_run(scene.stepped(integrator=integrator, substeps=substeps))[0]
        for integrator, substeps in REFERENCES
    ]
    length = Simulator(scene).mechanism.length
    reference, between = found[0], _error(found[0], found[1], length)
    if not between <= KNOWN * wanted_m:
        rule = f"must be at least {1.0 / KNOWN:g} times what references differ by, {between:.1e} m"
        raise InvalidInputError("error", wanted_m, rule)
    tried = []
    for integrator in get_args(IntegratorName):
        substeps = 1
        while True:
            show(f"{integrator}, {substeps}")
            one = _tried(scene, integrator, substeps, reference, length, clock)
            if one.error_m <= wanted_m or 2 * substeps > MOST_SUBSTEPS:
                break
            substeps *= 2
        tried.append(one)
    return StepChoices(wanted_m, between, tuple(tried))


def _tried(
    scene: Scene,
    integrator: IntegratorName,
    substeps: int,
    reference: Runs,
    length: float,
    clock: Callable[[], float],
) -> StepChoice:
    """Return an integrator's error and time."""
    other = scene.stepped(integrator=integrator, substeps=substeps)
    try:
        error = _error(experiment_run(other)[0], reference, length)
        return StepChoice(integrator, substeps, error, _time(other, clock))
    except HapticMechError as failed:
        return StepChoice(integrator, substeps, failed=str(failed))


def _error(one: Runs, other: Runs, length: float) -> float:
    position, rotation, _ = away(one, other)
    return max(position, length * rotation)


def _time(scene: Scene, clock: Callable[[], float]) -> float:
    """Return the CPU time of a period's steps, s, of a mechanism that is left to itself."""
    simulator = Simulator(scene)
    start = simulator.initial_state()
    taken = []
    for _ in range(REPEATS):
        begun = clock()
        simulator.run(start, TIMED_PERIODS, every=TIMED_PERIODS)
        taken.append((clock() - begun) / TIMED_PERIODS)
    return float(np.median(taken))
