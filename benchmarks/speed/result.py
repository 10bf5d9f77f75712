# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""One run in a race: a peer's method at a step, what it found and what it cost."""

from __future__ import annotations

import time
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from math import inf
from typing import TypeVar

import numpy as np

from benchmarks.speed.contender import (
    Contender,
    Method,
    Peer,
    Setting,
    State,
    UnsuitableError,
)
from benchmarks.speed.problems import Problem
from hapticmech_ros.errors import HapticMechError

Key = TypeVar("Key")
# What a run may fail by and still be a result.
FAILURES = (
    HapticMechError,
    ArithmeticError,
    np.linalg.LinAlgError,
    LookupError,
    RuntimeError,
    ValueError,
)


@dataclass(frozen=True, slots=True)
class RunResult:
    """What was found of a peer's method at a step.

    Attributes:
        problem, peer, method: names.
        step: s.
        setting: of the closures, that came closest.
        error: largest against the reference, m or rad; infinite after a failure, as are all times.
        failure: why there is no error; empty if there is.
        cpu_s_per_s: CPU time per simulated second, of each run.
        suitable: whether the peer can do the scene at all.
        raced: whether it was timed in turn with the others; else its one time is that of the run
            that was compared.
    """

    problem: str
    peer: str
    method: str
    step: float
    setting: Mapping[str, float] = field(default_factory=dict)
    error: float = inf
    failure: str = ""
    cpu_s_per_s: tuple[float, ...] = ()
    suitable: bool = True
    raced: bool = False

    @property
    def median(self) -> float:
        """Of the CPU times, s per simulated second."""
        return self._quantile(0.5)

    @property
    def p90(self) -> float:
        """Tail of the CPU times, s per simulated second."""
        return self._quantile(0.9)

    @property
    def slowest(self) -> float:
        """Largest of the CPU times, s per simulated second."""
        return self._quantile(1.0)

    def _quantile(self, share: float) -> float:
        return float(np.quantile(self.cpu_s_per_s, share)) if self.cpu_s_per_s else inf


def run_once(
    problem: Problem, start: State, peer: Peer, method: Method, step: float, setting: Setting
) -> tuple[RunResult, Contender | None]:
    """Run a problem once, compare it, and return the contender for more runs; None if it failed."""
    about = (problem.name, peer.name, method.name, step, dict(setting))
    try:
        contender = peer.contender(problem.scene, start, method, step, setting)
        warm_up(contender)
        error, cpu_s = compared(contender, problem, step)
    except UnsuitableError as unsuitable:
        return RunResult(*about, failure=unsuitable.reason, suitable=False), None
    except FAILURES as failure:
        return RunResult(*about, failure=f"{type(failure).__name__}: {failure}"), None
    if not np.isfinite(error):
        return RunResult(*about, failure="the motion is lost"), None
    return RunResult(*about, error=error, cpu_s_per_s=(cpu_s / problem.times[-1],)), contender


def warm_up(contender: Contender) -> None:
    """Take a few steps, so that code is loaded and compiled, and go back."""
    contender.advance(3)
    contender.restart()


def compared(contender: Contender, problem: Problem, step: float) -> tuple[float, float]:
    """Run a problem from its start; return error (m or rad) and CPU time in steps (s).

    Raises:
        InvalidInputError: the step misses a time of comparison.
    """
    taken, cpu_s, readings = 0, 0.0, []
    for number in problem.outputs[0].numbers(step):
        begun = time.process_time()
        contender.advance(number - taken)
        cpu_s += time.process_time() - begun
        taken = number
        readings.append(contender.read(problem.outputs))
    return problem.error(readings), cpu_s


def timed(contender: Contender, steps: int) -> float:
    """Return the CPU time (s) of so many steps from the start."""
    contender.restart()
    begun = time.process_time()
    contender.advance(steps)
    return time.process_time() - begun


def timed_in_turn(
    racers: Mapping[Key, tuple[Contender, int]], repeats: int
) -> dict[Key, list[float]]:
    """Return the CPU times (s) of a step of contenders, each of so many steps, in turn.

    A run that fails has no time, and a contender without a time is left out.
    """
    times = {key: list[float]() for key in racers}
    for _ in range(repeats):
        for key, (contender, steps) in racers.items():
            with suppress(*FAILURES):
                times[key].append(timed(contender, steps) / steps)
    return {key: taken for key, taken in times.items() if taken}
