"""One run of the accuracy benchmark: a case by an integrator at a step, compared and timed."""

from __future__ import annotations

import time
from dataclasses import dataclass, field

import numpy as np

from hapticmech_ros.bench.accuracy.plan import Setting
from hapticmech_ros.bench.accuracy.watch import Watch
from hapticmech_ros.errors import HapticMechError
from hapticmech_ros.mechanism import Mechanism
from hapticmech_ros.simulation import MechanismState, Simulator

# What a run may fail by and still be a result: an error of ours, arithmetic that broke down, an
# integrator or element that a scene may name and the mechanism does not have.
FAILURES = (HapticMechError, ArithmeticError, np.linalg.LinAlgError, LookupError)
# Steps between two looks at the clock, whose call is not free.
BLOCK = 100
# Before the clock starts, as a share of a run: kernels are loaded, caches fill.
WARM_UP, WARM_UP_SHARE = 200, 0.02


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
            watch, cpu_s_per_s = _stepped(setting)
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
        cpu_s_per_s=cpu_s_per_s,
    )


def _stepped(setting: Setting) -> tuple[Watch, float]:
    """Return what was seen on the way, and the CPU time of steps per simulated second."""
    scene, steps = setting.scene, round(setting.case.duration / setting.step)
    simulator = Simulator(scene)
    watch = Watch(setting.case, setting.step, Mechanism(scene))
    start = simulator.initial_state()
    _advance(simulator, start, max(1, min(WARM_UP, round(WARM_UP_SHARE * steps))))
    watch.see(0, start)
    state, taken, cpu_s = start, 0, 0.0
    while taken < steps:
        begun = time.process_time()
        states = _advance(simulator, state, min(BLOCK, steps - taken))
        cpu_s += time.process_time() - begun
        for number, seen in enumerate(states, taken + 1):
            watch.see(number, seen)
        taken, state = taken + len(states), states[-1]
    return watch, cpu_s / (steps * setting.step)


def _advance(simulator: Simulator, state: MechanismState, steps: int) -> list[MechanismState]:
    """Return the states of some steps, left alone by any hand."""
    nothing = np.zeros((len(simulator.mechanism.point_names), 6))
    states = []
    for _ in range(steps):
        state = simulator.step(state, nothing)
        states.append(state)
    return states
