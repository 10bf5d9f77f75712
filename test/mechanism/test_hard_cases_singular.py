"""Singular positions: passed with a sample on them, started from, and held at under load.

In line, two windows (IFToMM benchmark A02) lose two of four rows: other branches open there, and
to first order nothing says which one is taken.
"""

import numpy as np
import pytest
from scipy.optimize import brentq

from hapticmech_ros.bench.accuracy import n_four_bar
from hapticmech_ros.mechanism import Simulator
from hapticmech_ros.mechanism.redundancy import redundancy
from oracles import pendulum
from oracles.running import run, total_energy, unaccounted

UPRIGHTS = [0, 2, 4]
CLOSED = 1e-11
BOTH = pytest.mark.parametrize("compiled", [True, False])


def windows(compiled=True, gravity=(0.0, -9.81, 0.0), start=None, count=2, **simulation):
    scene = n_four_bar(count)
    changes = {
        "simulation": scene.simulation.model_copy(update=simulation),
        "gravity": gravity,
    }
    if start is not None:
        changes["initial_state"] = scene.initial_state.model_copy(update=start)
    return Simulator(scene.model_copy(update=changes), compiled)


def in_line(speed=0.0, count=2):
    """Return a start with all rods along x, the uprights turning at ``speed`` (rad/s)."""
    tops = {f"j_top{k}": -speed for k in range(count)}
    return {"q": {}, "v": {f"j_upright{k}": speed for k in range(count + 1)} | tops}


def falls_in_line():
    """Return when the windows first are in line, s."""
    return brentq(lambda time: pendulum.windows(2, [time])[0, 1], 0.7, 0.73, xtol=1e-15)


@BOTH
@pytest.mark.parametrize("steps", [714, 1428])
def test_a_sample_on_a_singular_position_keeps_the_branch(compiled, steps):
    half = falls_in_line()
    period = half / steps
    sim = windows(compiled, period=period)
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
    # For the one stage on it the rank leaves two accelerations free that the branch does not:
    # an error of the size of gravity for one step, g h^2 in the motion of 2 pi of its own.
    off = np.abs(tip - pendulum.windows(2, [2 * half])[0]).max()
    assert off < 0.1 * period**2
    assert abs(total_energy(sim, states[-1]) - 35.835) < 3.0 * period**2


@BOTH
@pytest.mark.parametrize("speed", [2.0, -5.0])
def test_a_start_on_a_singular_position_goes_on_along_its_branch(compiled, speed):
    sim = windows(compiled, start=in_line(speed))
    states = run(sim, 0.1)
    assert np.abs(states[0].v[UPRIGHTS] - speed).max() < 1e-12
    assert max(np.ptp(state.q[UPRIGHTS]) for state in states) < 1e-9
    # The first stage is on it: what it gets wrong for a step is of order h^2, see above.
    assert np.abs(unaccounted(sim, states)).max() < 3.0 * sim.period**2


@BOTH
def test_it_hangs_at_a_singular_position_under_its_weight(compiled):
    sim = windows(compiled, gravity=(9.81, 0.0, 0.0), start=in_line())
    states = run(sim, 0.3)
    assert max(np.abs(state.q).max() for state in states) < 1e-12
    assert max(np.abs(state.v).max() for state in states) < 1e-12
    assert max(state.closure_error for state in states) < 1e-13


@BOTH
@pytest.mark.parametrize("force", [1.0, 100.0])
def test_pulled_along_the_line_it_stays_there(compiled, force):
    sim = windows(compiled, gravity=(0.0, 0.0, 0.0), start=in_line())
    states = run(sim, 0.2, np.array([[force, 0.0, 0.0, 0.0, 0.0, 0.0]]))
    assert max(np.abs(state.q).max() for state in states) < 1e-12
    assert abs(states[-1].account.work_in) < 1e-12


def pushed_off(count, compiled, force):
    """Return simulator and states of windows at rest in line, their first tip pushed across."""
    sim = windows(compiled, count=count, gravity=(0.0, 0.0, 0.0), start=in_line(count=count))
    return sim, run(sim, 0.2, np.array([[0.0, force, 0.0, 0.0, 0.0, 0.0]]))


@BOTH
@pytest.mark.parametrize("count", [1, 2, 3])
@pytest.mark.parametrize("force", [1.0, -30.0, 1e3])
def test_pushed_off_a_singular_position_it_stays_closed_and_gains_no_energy(count, compiled, force):
    """Which branch it leaves by is open: first-order mobility says so before anything moves."""
    sim, states = pushed_off(count, compiled, force)
    assert redundancy(sim.mechanism, states[0].q, states[0].active).mobility == count + 1
    assert max(state.closure_error for state in states) < CLOSED
    assert all(np.isfinite(state.q).all() for state in states)
    balance = unaccounted(sim, states)
    assert balance.max() < 1e-12 * max(states[-1].account.work_in, 1.0)
    # The speed of the first step across the branch is lost: (F h)^2 over an inertia of 2 kg m^2.
    assert balance.min() > -0.5 * (force * sim.period) ** 2


@pytest.mark.parametrize("force", [1.0, -30.0, 1e3])
def test_one_window_pushed_off_its_singular_position_swings(force):
    _, states = pushed_off(1, True, force)
    travel = states[-1].q[0]
    # Two uprights of 1/3 kg m^2 and a top of 1 kg on a radius of 1 m: 5/3 kg m^2.
    shorter = min(0.5 * abs(force) / (5.0 / 3.0) * 0.2**2, 1.0)
    assert np.sign(travel) == np.sign(force)
    assert abs(travel) > 0.9 * shorter


@pytest.mark.xfail(
    reason="near a singular position rows whose singular value is below the square root of what "
    "the projection leaves open say nothing true, and lock it"
)
@BOTH
@pytest.mark.parametrize("force", [1.0, -30.0, 1e3])
def test_two_windows_pushed_off_their_singular_position_swing(compiled, force):
    _, states = pushed_off(2, compiled, force)
    assert abs(states[-1].q[0]) > 1e-3


def test_two_windows_keep_their_branch_for_ten_seconds():
    sim = windows()
    state, nothing = sim.initial_state(), np.zeros((1, 6))
    apart = worst = 0.0
    for _ in range(10_000):
        state = sim.step(state, nothing)
        apart = max(apart, float(np.ptp(state.q[UPRIGHTS])))
        worst = max(worst, state.closure_error)
    # Two branches are radians apart; nearest to a singular position rounding counts 1 / sigma^2.
    assert apart < 1e-9
    assert worst < CLOSED
    assert abs(total_energy(sim, state) - 35.835) < 1e-8
