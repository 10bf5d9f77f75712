# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Singular positions: passed with a sample on them, started from, and held at under load.

In line, two windows (IFToMM benchmark A02) lose two of four rows: other branches open there, and
to first order nothing says which one is taken.
"""

import numpy as np
import pytest
from scipy.optimize import brentq

from benchmarks.accuracy import n_four_bar
from hapticmech_ros.mechanism.redundancy import redundancy
from hapticmech_ros.simulation import Simulator
from oracles import pendulum
from oracles.planar_linkages import chain, elbow, pin_end
from oracles.running import (
    run,
    simulator,
    total_energy,
    unaccounted,
    varied,
    with_start,
    wrenches_on,
)

UPRIGHTS = [0, 2, 4]
CLOSED = 1e-11
UP = np.eye(6)[1]


def windows(gravity=(0.0, -9.81, 0.0), start=None, count=2, **simulation):
    scene = varied(n_four_bar(count), gravity=gravity, initial_state=start or {})
    return Simulator(scene.stepped(**simulation))


def in_line(speed=0.0, count=2):
    """Return a start with all rods along x, the uprights turning at ``speed`` (rad/s)."""
    tops = {f"j_top{k}": -speed for k in range(count)}
    return {"q": {}, "v": {f"j_upright{k}": speed for k in range(count + 1)} | tops}


def falls_in_line():
    """Return when the windows first are in line, s."""
    return brentq(lambda time: pendulum.windows(2, [time])[0, 1], 0.7, 0.73, xtol=1e-15)


@pytest.mark.parametrize("steps", [714, 1428])
def test_a_sample_on_a_singular_position_keeps_the_branch(steps):
    half = falls_in_line()
    period = half / steps
    sim = windows(period=period)
    states = run(sim, 2 * half)
    on_it = states[steps]
    found = redundancy(sim.mechanism, on_it.q, on_it.active)
    assert (found.rank, found.mobility) == (2, 3)
    assert all(
        redundancy(sim.mechanism, states[k].q, states[k].active).rank == 4
        for k in (steps - 1, steps + 1)
    )
    assert max(np.ptp(state.q[UPRIGHTS]) for state in states) < 1e-9
    assert max(state.closure_error for state in states) < CLOSED
    tip = sim.mechanism.frame_pose(states[-1].q, "b0").translation[:2]
    # As good as passing it between two samples: the step from it is led along the branch.
    off = np.abs(tip - pendulum.windows(2, [2 * half])[0]).max()
    assert off < 1e-11
    assert abs(total_energy(sim, states[-1]) - 35.835) < 1e-9


@pytest.mark.parametrize("period", [1e-3, 2.5e-4])
@pytest.mark.parametrize("share", [0.46, 0.5, 0.501, 0.54])
def test_a_step_with_its_middle_next_to_a_singular_position_keeps_the_energy(period, share):
    """Stages of a step are not on the closures, and there the rows say nothing of a branch."""
    passed = falls_in_line()
    steps = round(passed / period)
    period = passed / (steps + share)
    quick, nothing = windows(period=period), np.zeros((1, 6))
    before = quick.run(quick.initial_state(), steps - 5).end
    sim = windows(period=period)
    states = [before]
    for _ in range(10):
        states.append(sim.step(states[-1], nothing))
    assert states[5].time < passed < states[6].time
    assert max(np.ptp(state.q[UPRIGHTS]) for state in states) < 1e-9
    assert max(abs(total_energy(sim, state) - 35.835) for state in states) < 1e-10


@pytest.mark.parametrize("speed", [2.0, -5.0])
def test_a_start_on_a_singular_position_goes_on_along_its_branch(speed):
    sim = windows(start=in_line(speed))
    states = run(sim, 0.1)
    assert np.abs(states[0].v[UPRIGHTS] - speed).max() < 1e-12
    assert max(np.ptp(state.q[UPRIGHTS]) for state in states) < 1e-9
    # A twentieth of the first step is a Taylor series of order 2.
    kinetic = 0.5 * 3.0 * speed**2
    assert np.abs(unaccounted(sim, states)).max() < 1e-11 * kinetic


def test_it_hangs_at_a_singular_position_under_its_weight():
    sim = windows(gravity=(9.81, 0.0, 0.0), start=in_line())
    states = run(sim, 0.3)
    assert max(np.abs(state.q).max() for state in states) < 1e-12
    assert max(np.abs(state.v).max() for state in states) < 1e-12
    assert max(state.closure_error for state in states) < 1e-13


def pushed_off(count, force):
    """Return simulator and states of windows at rest in line, their first tip pushed across."""
    sim = windows(count=count, gravity=(0.0, 0.0, 0.0), start=in_line(count=count))
    return sim, run(sim, 0.2, np.array([[0.0, force, 0.0, 0.0, 0.0, 0.0]]))


@pytest.mark.parametrize("count", [1, 2, 3])
@pytest.mark.parametrize("force", [1.0, -30.0, 1e3])
def test_pushed_off_a_singular_position_it_stays_closed_and_keeps_its_energy(count, force):
    """Which branch it leaves by is open: first-order mobility says so before anything moves."""
    sim, states = pushed_off(count, force)
    assert redundancy(sim.mechanism, states[0].q, states[0].active).mobility == count + 1
    assert max(state.closure_error for state in states) < CLOSED
    assert all(np.isfinite(state.q).all() for state in states)
    # The first step's Taylor series is good to 1e-6 of what it gains; the rest is rk4's, which at
    # 1000 N sees the uprights turn by more than 0.02 a step.
    work = [abs(state.account.work_in) for state in states]
    assert np.abs(unaccounted(sim, states)).max() < 1e-6 * work[1] + 1e-8 * max(work)


@pytest.mark.parametrize("force", [1.0, -30.0, 1e3])
def test_one_window_pushed_off_its_singular_position_swings(force):
    _, states = pushed_off(1, force)
    travel = states[-1].q[0]
    # Two uprights of 1/3 kg m^2 and a top of 1 kg on a radius of 1 m: 5/3 kg m^2.
    shorter = min(0.5 * abs(force) / (5.0 / 3.0) * 0.2**2, 1.0)
    assert np.sign(travel) == np.sign(force)
    assert abs(travel) > 0.9 * shorter


@pytest.mark.parametrize("force", [1e-2, 1.0, -30.0, 1e3])
def test_two_windows_pushed_off_their_singular_position_swing(force):
    """Only with all uprights parallel does the first tip yield; which branch that is decides Gauss.

    Three uprights of 1/3 kg m^2 and two tops of 1 kg on a radius of 1 m: 3 kg m^2.
    """
    sim, states = pushed_off(2, force)
    # φ is right to 1e-14, and says where the branch is with a σ of 1e-6 at the least.
    assert max(np.ptp(state.q[UPRIGHTS]) for state in states) < 3e-8
    balance = unaccounted(sim, states)
    assert np.abs(balance).max() < 5e-6 * np.abs(states[-1].account.work_in) + 1e-12
    first = np.array([state.q[0] for state in states[:20]])
    times = sim.period * np.arange(20)
    # cos of the angle lessens the torque, by half of the angle's square.
    share = 1.0 - 0.5 * first[-1] ** 2
    expected = 0.5 * force / 3.0 * times**2
    assert (np.abs(first) <= np.abs(expected) * 1.001 + 1e-15).all()
    assert (np.abs(first) >= np.abs(expected) * share * 0.999 - 1e-15).all()


def folding_parallelogram(angle=0.0, side=0):
    """Return cranks of 1 m and a coupler of 2 m, in line or with the first crank at ``angle``.

    On one side of the diagonal the cranks stay parallel, on the other they turn against each other,
    in a ratio that changes with the angle.
    """
    lengths, masses = np.array([1.0, 2.0, 1.0]), np.array([1.0, 2.0, 0.7])
    document = pin_end(chain(lengths, masses, masses * lengths**2 / 12.0), np.array([2.0, 0.0]))
    absolute = np.array([angle, 0.0, np.pi])
    if side:
        tip = np.array([np.cos(angle), np.sin(angle)])
        absolute[1:] = elbow(tip, 2.0, 1.0, np.array([2.0, 0.0]), side)
    return simulator(with_start(document, np.diff(absolute, prepend=0.0)))


@pytest.mark.parametrize(
    "push",
    [
        {"end1": 3.0 * UP},
        {"end2": 3.0 * UP},
        {"end1": 3.0 * UP, "end2": -2.0 * UP},
        {"end3": np.eye(6)[5]},
    ],
    ids=["first crank", "second crank", "both against each other", "torque"],
)
def test_it_leaves_by_the_branch_that_takes_up_most(push):
    """Gauss's principle against both branches' own accelerations, next to the crossing."""
    sim = folding_parallelogram()
    wrenches = wrenches_on(sim, **push)
    best, expected = -np.inf, np.zeros(3)
    for side in (1, -1):
        near = folding_parallelogram(1e-3, side)
        terms = near.evaluate(near.initial_state())
        force = sum(w @ point.jacobian for w, point in zip(wrenches, terms.points, strict=True))
        acceleration, _ = terms.acceleration(force)
        if force @ acceleration > best:
            best, expected = force @ acceleration, acceleration
    states = run(sim, 0.01, wrenches)
    moved = states[-1].q - states[0].q
    # The branches' ratio, and the forces along them, change by the order of the angles, 1e-3 here.
    assert np.abs(moved - 0.5 * expected * 0.01**2).max() < 5e-3 * np.abs(moved).max()
    assert np.abs(unaccounted(sim, states)).max() < 1e-6 * states[-1].account.work_in
    assert max(state.closure_error for state in states) < CLOSED
