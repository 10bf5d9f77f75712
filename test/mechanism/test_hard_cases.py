# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Mechanisms that are hard on a solver: what must hold, and what is told where it cannot.

Never NaN, never silence: a step gives a closed, finite state or raises an error of the package.
"""

import numpy as np
import pytest

from benchmarks.accuracy import cases, n_four_bar
from hapticmech_ros.errors import ClosureError, HapticMechError
from hapticmech_ros.mechanism.redundancy import redundancy
from hapticmech_ros.mechanism.schemes import SCHEMES
from hapticmech_ros.simulation import Simulator
from oracles import pendulum
from oracles.frames import placed
from oracles.planar_linkages import five_bar, five_bar_bent
from oracles.planar_loops import Loop
from oracles.running import run, simulator, total_energy, unaccounted, with_start

CASES = {case.name: case for case in cases()}
CLOSED = 1e-11
LENGTHS, PIVOT = np.array([0.3, 0.9, 0.7]), np.array([0.8, 0.1])


def four_bar(masses=(0.5, 1.5, 1.0), gravity=-9.81):
    masses = np.array(masses)
    return Loop(LENGTHS, masses, masses * LENGTHS**2 / 12.0, PIVOT, gravity=gravity)


def turned(document, rotation):
    """Return a planar four-bar in space, all of it turned, its last pin a hinge: 5 rows, rank 2."""
    (pin,) = document["closures"]
    spatial = {"task_space": "spatial", "closures": [pin | {"kind": "revolute"}]}
    return placed(document | spatial, (rotation, np.zeros(3)))


def test_a_four_bar_moves_alike_however_it_lies_in_space():
    start = four_bar().document(np.array([1.1]), np.array([5.0]))
    flat = run(simulator(start), 0.2)
    rng = np.random.default_rng(4)
    for _ in range(50):
        rotation, _ = np.linalg.qr(rng.normal(size=(3, 3)))
        rotation *= np.sign(np.linalg.det(rotation))
        sim = simulator(turned(start, rotation))
        states = run(sim, 0.2)
        apart = max(np.abs(a.q - b.q).max() for a, b in zip(flat, states, strict=True))
        assert apart < 1e-9
        assert max(state.closure_error for state in states) < CLOSED
        found = redundancy(sim.mechanism, states[-1].q, states[-1].active)
        assert (found.rows, found.rank, found.mobility) == (5, 2, 1)


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


def test_twenty_closures_more_than_needed_change_nothing():
    once = with_start(five_bar(gravity_y=-9.81), five_bar_bent(1.9, 0.6))
    (pin,) = once["closures"]
    often = once | {"closures": [pin | {"name": f"pin{k}"} for k in range(21)]}
    expected, sim = run(simulator(once), 0.2), simulator(often)
    states = run(sim, 0.2)
    apart = max(np.abs(a.q - b.q).max() for a, b in zip(expected, states, strict=True))
    assert apart < 1e-9
    assert max(state.closure_error for state in states) < CLOSED
    found = redundancy(sim.mechanism, states[-1].q, states[-1].active)
    assert (found.rows, found.rank, len(found.wholly_redundant)) == (42, 2, 20)


def test_bricard_under_load_keeps_one_freedom_and_its_energy_account():
    case = CASES["bricard"]
    sim = Simulator(case.scene)
    # From where it hangs low: the load would otherwise hold it at the start.
    push = np.array([[8.0, 5.0, -6.0, 0.3, -0.2, 0.1]])
    states = run(sim, 0.5, push)
    moved = states[-1].q - states[0].q
    assert np.abs(moved).max() > 0.1
    for state in states[::50]:
        found = redundancy(sim.mechanism, state.q, state.active)
        assert (found.rank, found.mobility, len(found.redundant)) == (4, 1, 1)
    assert max(state.closure_error for state in states) < CLOSED
    fallen = max(sim.mechanism.energy(state.q, state.v)[0] for state in states)
    assert np.abs(unaccounted(sim, states)).max() < 1e-7 * fallen


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
