# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Mechanisms that are hard on a solver: what must hold, and what is told where it cannot.

Never NaN, never silence: a step gives a closed, finite state or raises an error of the package.
"""

import numpy as np
import pytest

from benchmarks.accuracy import n_four_bar
from hapticmech_ros.errors import ClosureError, HapticMechError
from hapticmech_ros.mechanism.schemes import SCHEMES
from hapticmech_ros.simulation import Simulator
from oracles import pendulum
from oracles.planar_loops import Loop
from oracles.running import run, simulator, total_energy, unaccounted

CLOSED = 1e-11
LENGTHS, PIVOT = np.array([0.3, 0.9, 0.7]), np.array([0.8, 0.1])


def four_bar(masses=(0.5, 1.5, 1.0), gravity=-9.81):
    masses = np.array(masses)
    return Loop(LENGTHS, masses, masses * LENGTHS**2 / 12.0, PIVOT, gravity=gravity)


@pytest.mark.parametrize(
    "masses", [(1.0, 1e-6, 1.0), (1e-6, 1.0, 1e-6), (1.0, 1.0, 1e-6), (1e-6, 1e-6, 1.0)]
)
def test_links_a_million_times_lighter_than_others(masses):
    loop, u, speed = four_bar(masses), np.array([1.1]), np.array([3.0])
    sim = simulator(loop.document(u, speed), 5e-4)
    states = run(sim, 0.1)
    angles = np.cumsum(states[-1].q)
    (expected,) = loop.motion(u, speed, [0.1])
    # Rounding is magnified by the mass ratio at most; truncation is that of other loops.
    assert np.abs(np.exp(1j * angles) - np.exp(1j * expected)).max() < 1e-9
    assert max(state.closure_error for state in states) < CLOSED
    assert np.abs(unaccounted(sim, states)).max() < 1e-9 * abs(total_energy(sim, states[0]))


def test_forty_windows_begin_as_one_pendulum():
    sim = Simulator(n_four_bar(40))
    states = run(sim, 0.02)
    tip = sim.mechanism.frame_pose(states[-1].q, "b0").translation[:2]
    assert np.abs(tip - pendulum.windows(40, [0.02])[0]).max() < 1e-10
    assert max(state.closure_error for state in states) < CLOSED
    assert np.ptp(states[-1].q[0::2]) < 1e-10
    assert sim.evaluate(states[-1]).space.rank == 80


@pytest.mark.parametrize("integrator", SCHEMES)
@pytest.mark.parametrize("speed", [30.0, 300.0, 3e3, 3e4, 1e8])
@pytest.mark.filterwarnings("ignore::RuntimeWarning")
def test_far_too_long_a_step_closes_or_is_an_error_with_a_name(integrator, speed):
    start = four_bar().document(np.array([1.1]), np.array([speed]))
    sim = simulator(start, 4e-3, integrator)
    state = sim.initial_state()
    try:
        for _ in range(50):
            state = sim.step(state, np.zeros((6, 6)))
            assert np.isfinite(state.q).all()
            assert np.isfinite(state.v).all()
            assert state.closure_error <= 1e-6 * sim.mechanism.length
    except HapticMechError as error:
        assert str(error)  # noqa: PT017
    else:
        assert speed < 1e8


def test_a_load_beyond_all_measure_tears_the_loop_and_says_which():
    sim = simulator(four_bar().document(np.array([1.1]), np.array([1.0])))
    wrenches = np.zeros((6, 6))
    wrenches[2, 0] = 1e12
    with pytest.raises(ClosureError, match="came apart") as caught:
        run(sim, 0.05, wrenches)
    assert caught.value.closures == ("pin",)
