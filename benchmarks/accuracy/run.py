# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Runs of the accuracy benchmark: a case by an integrator at a step, compared and timed."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import cast, get_args

import numpy as np

from benchmarks.accuracy.cases import Case, Output, cases
from benchmarks.words import refuse_unknown
from hapticmech_ros.errors import HapticMechError, InvalidInputError
from hapticmech_ros.mechanism import Mechanism
from hapticmech_ros.scene import Scene
from hapticmech_ros.scene.mechanism import IntegratorName
from hapticmech_ros.simulation import MechanismState, Simulator

# What a run may fail by and still be a result: an error of ours, arithmetic that broke down, an
# integrator or element that a scene may name and the mechanism does not have.
FAILURES = (HapticMechError, ArithmeticError, np.linalg.LinAlgError, LookupError)
# Steps between two looks at the clock, whose call is not free.
BLOCK = 100
# Before the clock starts, as a share of a run: kernels are loaded, caches fill.
WARM_UP, WARM_UP_SHARE = 200, 0.02
INTEGRATOR_NAMES: tuple[IntegratorName, ...] = get_args(IntegratorName)
# Multiples of the step that a case's scene has, which a squeezer in hundredths of a second and a
# pendulum in seconds can share.
MULTIPLES = (4.0, 2.0, 1.0, 0.5, 0.25)
# A step of a large case takes as long as many of a small one.
LARGE_MULTIPLES = (8.0, 4.0, 2.0)
QUICK_MULTIPLES = (2.0, 1.0)
LARGE = "large"
# Scenes step by 1 ms or less, and the schema takes no more than 100 ms.
LARGEST_MULTIPLE = 100.0


@dataclass(frozen=True, slots=True)
class Setting:
    """One run: a case by an integrator at a step (s)."""

    case: Case
    integrator: IntegratorName
    step: float

    @property
    def own(self) -> bool:
        """Whether integrator and step are those of the case's scene."""
        simulation = Mechanism(self.case.scene).scene.simulation
        return (self.integrator, self.step) == (simulation.integrator, simulation.period)

    @property
    def scene(self) -> Scene:
        """The case's scene with this integrator and step; nothing else is changed."""
        return self.case.scene.stepped(integrator=self.integrator, period=self.step)

    def __str__(self) -> str:
        return f"{self.case.name}, {self.integrator}, {1e3 * self.step:g} ms"


def settings(
    names: Sequence[str] = (),
    integrators: Sequence[str] = (),
    multiples: Sequence[float] = (),
    quick: bool = False,
    known: Sequence[Case] | None = None,
) -> tuple[Setting, ...]:
    """Return the runs, case by case.

    Args:
        names: of cases; all if empty.
        integrators: all if empty.
        multiples: steps, in steps of the case's own scene; 4 to 1/4 if empty, fewer for large ones.
        quick: few steps, and no large case unless it is named.
        known: cases to choose from; all of the library if None.

    Raises:
        InvalidInputError: unknown case or integrator, a step that is not above zero.
        SceneError: a scene is damaged.
    """
    by_name = {case.name: case for case in (cases() if known is None else known)}
    refuse_unknown("case", names, by_name)
    usual = [name for name, case in by_name.items() if not (quick and LARGE in case.tags)]
    refuse_unknown("integrator", integrators, INTEGRATOR_NAMES)
    for multiple in multiples:
        if not 0.0 < multiple <= LARGEST_MULTIPLE:
            rule = f"must be above 0, and at most {LARGEST_MULTIPLE:g} steps of the scene's own"
            raise InvalidInputError("step", multiple, rule)
    rules = cast("Sequence[IntegratorName]", integrators) or INTEGRATOR_NAMES
    return tuple(
        Setting(case, integrator, multiple * case.scene.simulation.period)
        for case in (by_name[name] for name in names or usual)
        for integrator in rules
        for multiple in multiples
        or (QUICK_MULTIPLES if quick else LARGE_MULTIPLES if LARGE in case.tags else MULTIPLES)
    )


@dataclass(frozen=True, slots=True)
class Run:
    """What was found.

    Attributes:
        case, integrator, step: what ran; s.
        unit: of errors, m or rad.
        own: whether integrator and step are those of the case's scene.
        failure: why there is nothing more; empty if there is.
        errors: by output, largest difference from the reference, m or rad.
        kept: whether each is within the output's tolerance; None unless ``own``.
        energy_error: largest difference from the energy that should be kept, J; None if none is.
        closure_error: largest residual of closed loops, m or rad.
        rank: of the closures at the start.
        rank_changes: samples whose rank differs from the one before's.
        unexpected_ranks: those of them that are not within a step of a singular time.
        singular_times: how many the case names.
        cpu_s_per_s: CPU time of the process in steps, per simulated second.
    """

    case: str
    integrator: str
    step: float
    unit: str
    own: bool
    failure: str = ""
    errors: dict[str, float] = field(default_factory=dict)
    kept: bool | None = None
    energy_error: float | None = None
    closure_error: float = 0.0
    rank: int = 0
    rank_changes: int = 0
    unexpected_ranks: int = 0
    singular_times: int = 0
    cpu_s_per_s: float | None = None

    @property
    def error(self) -> float | None:
        """Largest of the errors; None after a failure."""
        return max(self.errors.values()) if self.errors else None

    @property
    def real_time(self) -> float | None:
        """How many times faster than real time; None after a failure."""
        return 1.0 / self.cpu_s_per_s if self.cpu_s_per_s else None


def measure(setting: Setting) -> Run:
    """Carry out one run; one that fails is a result too, told in ``failure``."""
    units = {"m" if output.kind == "point" else "rad" for output in setting.case.outputs}
    about = (setting.case.name, setting.integrator, setting.step, " or ".join(sorted(units)))
    try:
        # States are checked after each step: what overflows in one is told as an error of ours.
        with np.errstate(over="ignore", invalid="ignore"):
            scene = setting.scene
            watch = Watch(setting.case, setting.step, Mechanism(scene))
            steps = round(setting.case.duration / setting.step)
            cpu_s = stepped(watch, Simulator(scene), steps)
    except FAILURES as failure:
        return Run(*about, setting.own, failure=f"{type(failure).__name__}: {failure}")
    errors = watch.errors()
    within = all(errors[output.name] <= output.tolerance for output in setting.case.outputs)
    return Run(
        *about,
        setting.own,
        errors=errors,
        kept=within if setting.own else None,
        energy_error=watch.energy_error,
        closure_error=watch.closure_error,
        rank=watch.ranks[0][1] if watch.ranks else 0,
        rank_changes=max(len(watch.ranks) - 1, 0),
        unexpected_ranks=watch.unexpected_ranks(),
        singular_times=len(setting.case.singular_times),
        cpu_s_per_s=cpu_s / (steps * setting.step),
    )


def stepped(watch: Watch, simulator: Simulator, steps: int) -> float:
    """Take steps from the start with a watch on each, and return the CPU time of these, s."""
    state, taken, cpu_s = simulator.initial_state(), 0, 0.0
    _advance(simulator, state, max(1, min(WARM_UP, round(WARM_UP_SHARE * steps))))
    watch.record(0, state)
    while taken < steps:
        begun = time.process_time()
        states = _advance(simulator, state, min(BLOCK, steps - taken))
        cpu_s += time.process_time() - begun
        for number, seen in enumerate(states, taken + 1):
            watch.record(number, seen)
        taken, state = taken + len(states), states[-1]
    return cpu_s


def _advance(simulator: Simulator, state: MechanismState, steps: int) -> list[MechanismState]:
    """Return the states of some steps, left alone by any hand."""
    nothing = np.zeros((len(simulator.mechanism.point_names), 6))
    states = []
    for _ in range(steps):
        state = simulator.step(state, nothing)
        states.append(state)
    return states


class Watch:
    """Compares the samples of a run with what its case says.

    A mechanism of its own, so that looking leaves no trace in the one that is stepped and timed.

    Args:
        case: what has to come out.
        step: s, between samples.
        mechanism: of the case's scene; evaluated, never stepped.

    Attributes:
        closure_error: largest residual of active closures, m or rad.
        energy_error: largest difference from the case's energy, J; None if it has none.
        ranks: (time s, rank) of the first sample, and of each whose rank differs from the one
            before.

    Raises:
        InvalidInputError: samples miss an output time.
    """

    def __init__(self, case: Case, step: float, mechanism: Mechanism) -> None:
        self._case, self._step, self._mechanism = case, step, mechanism
        self._numbers = [output.numbers(step) for output in case.outputs]
        self._wanted = {number for numbers in self._numbers for number in numbers}
        self._found: dict[int, list[tuple[float, ...]]] = {}
        self.closure_error = 0.0
        self.energy_error = None if case.energy is None else 0.0
        self.ranks: list[tuple[float, int]] = []

    def record(self, number: int, state: MechanismState) -> None:
        """Look at sample ``number``; 0 is the start."""
        self.closure_error = max(self.closure_error, state.closure_error)
        if any(state.active):
            rank = self._mechanism.closing_terms(state.q, state.active).space.rank
            if not self.ranks or self.ranks[-1][1] != rank:
                self.ranks.append((number * self._step, rank))
        if self._case.energy is not None and self.energy_error is not None:
            off = sum(self._mechanism.energy(state.q, state.v)) - self._case.energy
            self.energy_error = max(self.energy_error, abs(off))
        if number in self._wanted:
            self._found[number] = [
                read_output(self._mechanism, output, state) for output in self._case.outputs
            ]

    def errors(self) -> dict[str, float]:
        """Return the error of each output by its name, m or rad, once all samples were seen."""
        return {
            output.name: output.error([self._found[number][index] for number in numbers])
            for index, (output, numbers) in enumerate(
                zip(self._case.outputs, self._numbers, strict=True)
            )
        }

    def unexpected_ranks(self) -> int:
        """Return how many changes of rank are not within a step of a singular time."""
        singular = np.array(self._case.singular_times)
        return sum(
            not (np.abs(singular - time) <= 1.001 * self._step).any() for time, _ in self.ranks[1:]
        )


def read_output(mechanism: Mechanism, output: Output, state: MechanismState) -> tuple[float, ...]:
    """Return an output's components at a state, m or rad."""
    if output.kind == "joint":
        tree = mechanism.tree
        return output.parts(state.q[tree.position_slice(tree.joint_names.index(output.name))])
    return output.parts(mechanism.frame_pose(state.q, output.name).translation)
