# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What a haptic tick costs: a state evaluated and the point held analysed."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from importlib.util import find_spec

import numpy as np

from benchmarks.machine import cpu_times
from benchmarks.oracle import oracle
from benchmarks.speed.mujoco_peer import MujocoScene, at_start, stepping
from hapticmech_ros.errors import HapticMechError
from hapticmech_ros.loading import load_scene
from hapticmech_ros.numerics.layout import OperationalModelSample
from hapticmech_ros.operational import Analyser
from hapticmech_ros.scene import Scene
from hapticmech_ros.simulation import MechanismState, Simulator

SCENE = "five_bar"
# States on a motion under a steady push, N and N m, so that no two calls see the same.
STATES, PUSH = 200, (-0.5, 0.0, 0.0, 0.0, 0.0, -0.0025)
# Kernels and the null-space formula give the same Λ_h⁻¹, relative to its largest entry.
AGREEMENT = 1e-9
SEE, BOTH = "observe", "evaluate, analyse"
MJ_STEP = "mj_step"
_X = OperationalModelSample.layout.slice("inverse_inertia")


@dataclass(frozen=True, slots=True)
class TickTime:
    """CPU times of one call, s: median, 90th percentile and largest of repeated rounds."""

    name: str
    median: float
    p90: float
    slowest: float


def tick_times(rounds: int = 30) -> tuple[TickTime, ...]:
    """Return what ticks of the shipped five-bar cost, and one ``mj_step`` of it.

    Each is called once from Python per state, in turn with the others, round by round.
    Without MuJoCo its line is left out.

    Raises:
        HapticMechError: kernels and NumPy disagree.
    """
    scene = load_scene(SCENE)
    states, simulator = _states(scene), Simulator(scene)
    check_agreement(scene, states)
    analyser = Analyser(simulator.mechanism)

    def observe() -> None:
        for state in states:
            analyser.observe(state.q, state.v, state.active)

    def evaluate() -> None:
        for state in states:
            analyser.analyse(simulator.evaluate(state))

    callers: dict[str, Callable[[], None]] = {SEE: observe, BOTH: evaluate}
    if find_spec("mujoco"):
        callers[MJ_STEP] = stepping(*at_start(MujocoScene(scene), scene), STATES)
    return tuple(
        TickTime(name, *np.quantile(taken / STATES, (0.5, 0.9, 1.0)).tolist())
        for name, taken in cpu_times(callers, rounds).items()
    )


def check_agreement(scene: Scene, states: Sequence[MechanismState]) -> float:
    """Return the largest relative difference of Λ_h⁻¹ between kernels and independent rates.

    Raises:
        HapticMechError: it is above 1e-9.
    """
    simulator = Simulator(scene)
    analyser = Analyser(simulator.mechanism)
    rows, apart = np.ix_(analyser.rows, analyser.rows), 0.0
    for state in states:
        terms = simulator.evaluate(state)
        jacobian = terms.points[analyser.index].jacobian[analyser.rows]
        expected = oracle("closed_form").inverse_inertia(
            terms.inertia, terms.closure_jacobian, jacobian
        )
        scale = float(np.abs(expected).max())
        seen = analyser.observe(state.q, state.v, state.active).model
        both = analyser.analyse(terms).inverse_inertia, seen[_X].reshape(6, 6)
        apart = max(apart, *(float(np.abs(one[rows] - expected).max()) / scale for one in both))
    if not apart <= AGREEMENT:
        raise HapticMechError(f"Λ_h⁻¹ by kernels and by independent rates differ by {apart:.1e}")
    return apart


def _states(scene: Scene) -> list[MechanismState]:
    simulator = Simulator(scene)
    state, push = simulator.initial_state(), np.array([PUSH])
    states = []
    for _ in range(STATES):
        state = simulator.run(state, 10, push, 10).end
        states.append(state)
    return states
