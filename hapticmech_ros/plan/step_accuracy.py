# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""How far the mechanism's steps are from ten times shorter ones, over a scene's experiment.

A choice is made by it: which integrator, in how many steps of a period, does the experiment in the
least time.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import get_args

import numpy as np
from scipy.spatial.transform import Rotation

from hapticmech_ros.errors import HapticMechError, InvalidInputError, check_positive
from hapticmech_ros.scene import Scene
from hapticmech_ros.scene.mechanism import IntegratorName
from hapticmech_ros.session import Run, Session, SharedSession
from hapticmech_ros.simulation import Simulator
from hapticmech_ros.simulation.simulator import EnergyAccount

# Steps that are compared are shorter by this.
FINER = 10
# Ticks from one look at the clock to the next.
_STRETCH = 25
# Of an experiment, one for each user.
Runs = tuple[Run, ...]


@dataclass(frozen=True, slots=True)
class StepAccuracy:
    """Change of results by ten times shorter steps, and the energy account of the scene's own.

    Attributes:
        duration_s: of the experiment.
        position_m: largest difference of the operational point's position.
        rotation_rad: of its orientation.
        force_n: of the force on the hand.
        surplus_j: energy that steps made from nothing, or lost if negative.
        exchanged_j: work done on the mechanism, and losses.
        refined: steps that were repeated in smaller ones, or with higher accuracy.
        inaccurate: of these, how many were off by more than the tolerance all the same.
        failed: why one of the two ended early; empty if neither did.
        left_out: part that there was no time for; empty if there was.
    """

    duration_s: float
    position_m: float = 0.0
    rotation_rad: float = 0.0
    force_n: float = 0.0
    surplus_j: float = 0.0
    exchanged_j: float = 0.0
    refined: int = 0
    inaccurate: int = 0
    failed: str = ""
    left_out: str = ""


class _OutOfTime(Exception):
    """There is no time for the rest of an experiment."""


def step_accuracy(
    scene: Scene,
    is_over: Callable[[], bool] | None = None,
    show: Callable[[str], None] | None = None,
) -> StepAccuracy:
    """Run the scene's experiment at its own step and at a tenth of it, and return the difference.

    Device, hand and controllers keep their periods: only the mechanism's steps differ.

    Args:
        scene: whose experiment.
        is_over: whether the time is up: the rest is then left out; never if None.
        show: called with a description of the present work.
    """
    finer = scene.stepped(substeps=scene.simulation.substeps * FINER)
    found, what, share = StepAccuracy(scene.experiment.duration), "", 0.0

    def watch(done: float) -> None:
        nonlocal share
        share = done
        if show is not None:
            show(f"{what}: {done:.0%}")
        if is_over is not None and is_over():
            raise _OutOfTime

    try:
        what = "steps of the experiment"
        coarse, account = experiment_run(scene, watch)
        lost = account.damping_loss + account.latch_loss + abs(account.contact_loss)
        found = replace(
            found,
            surplus_j=account.surplus,
            exchanged_j=abs(account.work_in) + lost,
            refined=account.refined,
            inaccurate=account.inaccurate,
        )
        what = "the same with ten times shorter steps"
        fine, _ = experiment_run(finer, watch)
    except HapticMechError as error:
        return StepAccuracy(found.duration_s, failed=str(error))
    except _OutOfTime:
        return replace(found, left_out=f"{what}: {share:.0%} done when the time was up")
    position, rotation, force = away(coarse, fine)
    return replace(found, position_m=position, rotation_rad=rotation, force_n=force)


def away(ones: Runs, others: Runs) -> tuple[float, float, float]:
    """Return the largest differences of two experiments: of operational points, and of forces.

    Args:
        ones: of each user of one experiment.
        others: of the other.

    Returns:
        Of the points' positions, m, of their orientations, rad, and of the forces on the hands, N.
    """
    apart = [_apart(one, other) for one, other in zip(ones, others, strict=True)]
    position, rotation, force = np.max(apart, axis=0).tolist()
    return position, rotation, force


def _apart(one: Run, other: Run) -> tuple[float, float, float]:
    first, second = (Rotation.from_quat(run["quaternion"]) for run in (one, other))
    force = one["on_hand"][:, :3] - other["on_hand"][:, :3]
    return (
        float(np.linalg.norm(one["position"] - other["position"], axis=1).max()),
        float((first.inv() * second).magnitude().max()),
        float(np.linalg.norm(force, axis=1).max()),
    )


def experiment_run(
    scene: Scene, watch: Callable[[float], None] | None = None
) -> tuple[Runs, EnergyAccount]:
    """Return a scene's experiment from its start, and the mechanism's energy account at its end.

    Args:
        scene: whose experiment; all its users take part.
        watch: called with the share that is done, now and then; an exception from it ends the
            experiment.
    """
    start = min(scene.held_at(point).hand.start_delay for point in scene.held_points)
    ticks = max(1, round((start + scene.experiment.duration) / scene.simulation.period))
    session = SharedSession(scene) if len(scene.held_points) > 1 else Session(scene)
    stretches: list[Runs] = []
    done, most = 0, ticks if watch is None else _STRETCH
    while done < ticks:
        count = min(most, ticks - done)
        found = session.run(count)
        stretches.append((found,) if isinstance(found, Run) else tuple(found.values()))
        done += count
        if watch is not None:
            watch(done / ticks)
    runs = (
        Run(np.concatenate([part.rows for part in parts]), parts[0].layout)
        for parts in zip(*stretches, strict=True)
    )
    return tuple(runs), session.mechanism.account


# References for the others: two, to know their own error.
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
    """Step settings tried for a scene.

    Attributes:
        wanted_m: the requested error.
        reference_m: by which two references differ.
        tried: of each integrator the first number of steps that was accurate enough, or the last
            that was tried.
    """

    wanted_m: float
    reference_m: float
    tried: tuple[StepChoice, ...]

    @property
    def best(self) -> StepChoice | None:
        """The fastest one of those that are accurate enough; None if none is."""
        enough = [one for one in self.tried if one.error_m <= self.wanted_m]
        return min(enough, key=lambda one: one.time_s, default=None)


def step_choices(
    scene: Scene,
    wanted_m: float,
    clock: Callable[[], float],
    show: Callable[[str, float], None] = lambda text, share: None,
) -> StepChoices:
    """Try every integrator on a scene's experiment, in 1, 2, 4, ... steps of a period.

    Args:
        scene: whose experiment; its period is kept.
        wanted_m: largest error of the operational point, m.
        clock: CPU time, s.
        show: called with the setting being tried, and the share of all that is done.

    Returns:
        Errors and times of all, with the number of steps that each needs.

    Raises:
        InvalidInputError: an error that is not above 0.
        HapticMechError: a reference cannot do the experiment, or the two differ by more than a
            tenth of the error.
    """
    check_positive(error=wanted_m)
    names = get_args(IntegratorName)
    parts = len(REFERENCES) + len(names)
    found = list[Runs]()
    for part, (integrator, substeps) in enumerate(REFERENCES):
        show(f"reference: {integrator}, {substeps} substeps", part / parts)
        found.append(experiment_run(scene.stepped(integrator=integrator, substeps=substeps))[0])
    length = Simulator(scene).mechanism.length
    reference, between = found[0], _error(found[0], found[1], length)
    if not between <= KNOWN * wanted_m:
        rule = f"must be at least {1.0 / KNOWN:g} times what references differ by, {between:.1e} m"
        raise InvalidInputError("error", wanted_m, rule)
    tried = []
    for part, integrator in enumerate(names, start=len(REFERENCES)):
        substeps = 1
        while True:
            show(f"{integrator}, {substeps} substeps", part / parts)
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
