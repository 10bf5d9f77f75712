# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Long runs: what adds up over an hour, and whether a branch is kept for a minute."""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from benchmarks.accuracy.cases import Case, cases
from benchmarks.accuracy.n_four_bar import n_four_bar
from benchmarks.accuracy.run import FAILURES
from benchmarks.machine import MachineResults, machine
from hapticmech_ros.analysis.study import Sheet, Show, number, silent
from hapticmech_ros.scene import Scene
from hapticmech_ros.simulation import MechanismState, Simulator

HOUR, MINUTE = 3600.0, 60.0
# Between looks, and between lines that tell how far it is.
LOOK_STEPS, TOLD = 100, 60


@dataclass(frozen=True, slots=True)
class LongRun:
    """What was seen of a long run.

    Attributes:
        scene: name.
        duration: s that were asked for.
        reached: s that were simulated.
        failure: why it ended before; empty if it did not.
        energy_rise, energy_fall: most above and below the energy at the start, J, seen every 100
            steps.
        closure_error: largest of all steps, m or rad.
        ranks: of the closures, each that was seen every 100 steps.
        off_branch: largest angle between two uprights of a row of windows, rad; None elsewhere.
        cpu_s_per_s: CPU time of the process per simulated second.
    """

    scene: str
    duration: float
    reached: float
    failure: str
    energy_rise: float
    energy_fall: float
    closure_error: float
    ranks: tuple[int, ...]
    off_branch: float | None
    cpu_s_per_s: float


@dataclass(frozen=True)
class LongRuns(MachineResults):
    """What was seen of long runs.

    Attributes:
        runs: in order.
    """

    NAME: ClassVar[str] = "bench_accuracy_long"
    FAULT: ClassVar[str] = "a run ended before its time"

    runs: tuple[LongRun, ...]

    @property
    def sound(self) -> bool:
        """Whether none failed."""
        return not any(run.failure for run in self.runs)

    def sheets(self) -> Iterator[Sheet]:
        """Yield what was seen."""
        rows = tuple(
            (
                run.scene,
                f"{run.reached:g} of {run.duration:g} s",
                f"{run.energy_rise:.2e}",
                f"{run.energy_fall:.2e}",
                f"{run.closure_error:.1e}",
                ", ".join(map(str, run.ranks)),
                number(run.off_branch, ".1e"),
                f"{run.cpu_s_per_s:.3g}",
                run.failure,
            )
            for run in self.runs
        )
        headings = (
            *("scene", "simulated", "energy rises, J", "falls, J", "closures open"),
            *("ranks", "uprights apart, rad", "CPU, s/s", "failed"),
        )
        yield Sheet("long runs", headings, rows, ("failed",))


def endurance(show: Show = silent) -> LongRuns:
    """Run a minute of two windows and an hour of Bricard's mechanism."""
    bricard = next(case for case in cases() if case.name == "bricard")
    return LongRuns(machine(), (minute_of_windows(show=show), hour_of(bricard, show=show)))


def hour_of(case: Case, duration: float = HOUR, show: Show = silent) -> LongRun:
    """Run a case's scene as it is."""
    return _long_run(case.scene, duration, show, ())


def minute_of_windows(windows: int = 2, duration: float = MINUTE, show: Show = silent) -> LongRun:
    """Run a row of windows, whose uprights stay parallel unless it takes a wrong branch."""
    uprights = tuple(f"j_upright{k}" for k in range(windows + 1))
    return _long_run(n_four_bar(windows), duration, show, uprights)


def _long_run(scene: Scene, duration: float, show: Show, parallel: tuple[str, ...]) -> LongRun:
    simulator = Simulator(scene)
    tree = simulator.mechanism.tree
    places = [tree.position_slice(tree.joint_names.index(name)).start for name in parallel]
    nothing = np.zeros((len(simulator.mechanism.point_names), 6))
    steps, taken, failure = round(duration / simulator.period), 0, ""
    state = simulator.initial_state()
    seen = [_look(simulator, state, places)]
    closure_error, begun = state.closure_error, time.process_time()
    try:
        while taken < steps:
            for _ in range(min(LOOK_STEPS, steps - taken)):
                state = simulator.step(state, nothing)
                closure_error = max(closure_error, state.closure_error)
                taken += 1
            seen.append(_look(simulator, state, places))
            if taken % max(steps // TOLD, LOOK_STEPS) < LOOK_STEPS:
                show(f"{scene.name}: {state.time:.0f} s of {duration:g} s")
    except FAILURES as error:
        failure = f"{type(error).__name__}: {error}"
    cpu_s, reached = time.process_time() - begun, taken * simulator.period
    energies, ranks, angles = zip(*seen, strict=True)
    return LongRun(
        scene.name,
        duration,
        reached,
        failure,
        energy_rise=max(energies) - energies[0],
        energy_fall=energies[0] - min(energies),
        closure_error=closure_error,
        ranks=tuple(sorted(set(ranks))),
        off_branch=max(angles) if parallel else None,
        cpu_s_per_s=cpu_s / max(reached, simulator.period),
    )


def _look(
    simulator: Simulator, state: MechanismState, places: list[int]
) -> tuple[float, int, float]:
    """Return energy (J), rank, and the largest angle between joints at ``places`` (rad)."""
    rank = simulator.evaluate(state).space.rank
    energy = sum(simulator.mechanism.energy(state.q, state.v))
    return energy, rank, float(np.ptp(state.q[places])) if places else 0.0
