# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Redundant closures keep simulating, also where only the closed positions make them redundant.

Off the closed positions by phi, such rows are independent by about phi: a Runge-Kutta stage there
must not take them for closures of their own.
"""

import numpy as np
import pytest

from oracles.generator import blank, floats, random_mechanism
from oracles.kinematics import rpy_of_rotation
from oracles.loops import frame_along
from oracles.running import run, simulator, total_energy, unaccounted, with_start

SEEDS = [1, 2, 3, 5, 9]


def start(seed, duplicated):
    sample = random_mechanism(seed, duplicated=duplicated)
    return with_start(sample.document, sample.q, sample.v)


@pytest.mark.parametrize("seed", SEEDS)
def test_duplicated_closures_do_not_change_the_motion(seed):
    once = run(simulator(start(seed, False)), 0.2)
    twice = run(simulator(start(seed, True)), 0.2)
    apart = max(np.abs(a.v - b.v).max() for a, b in zip(once, twice, strict=True))
    # Stages off the closures by h^2 see the copies h^2 apart: truncation h^4 = 1e-12 times 1e3.
    assert apart < 1e-8 * max(np.abs(state.v).max() for state in once)
    assert max(state.closure_error for state in twice) < 1e-11


@pytest.mark.parametrize("seed", SEEDS)
def test_duplicated_closures_keep_the_power_balance(seed):
    sim = simulator(start(seed, True))
    states = run(sim, 0.2)
    scale = abs(total_energy(sim, states[0])) + sim.mechanism.energy(states[0].q, states[0].v)[0]
    # Truncation of rk4 at 1 ms and 3 rad/s, (3e-3)^4 = 1e-10 a step's share, and a margin.
    assert np.abs(unaccounted(sim, states)).max() < 1e-8 * scale


CORNERS = np.array([(0, 0, 0), (1, 0, 0), (1, 1, 0), (1, 1, 1), (0, 1, 1), (0, 0, 1)], dtype=float)


def bricard():
    """Return Bricard's six-bar on the edges of a unit cube: six hinges, mobility 1 instead of 0."""
    document = blank(gravity=(0.0, -9.81, 0.0))
    rods = np.roll(CORNERS, -1, axis=0) - CORNERS
    axes = [np.cross(rods[k - 1], rods[k]) for k in range(6)]
    at = np.zeros(3)
    for k in range(1, 6):
        origin = {"xyz": floats(CORNERS[k] - at)}
        at = CORNERS[k]
        joint = {"name": f"joint{k}", "type": "revolute", "axis": floats(axes[k])}
        across, along = np.abs(rods[k]) < 0.5, 1e-4
        moments = np.where(across, 1.0 / 12.0, along)
        inertia = dict(zip(("ixx", "iyy", "izz"), floats(moments), strict=True))
        inertial = {"mass": 1.0, "com": floats(0.5 * rods[k]), "inertia": inertia}
        document["links"].append(
            {
                "name": f"rod{k}",
                "parent": f"rod{k - 1}" if k > 1 else "world",
                "joint": joint | {"origin": origin},
                "inertial": inertial,
            }
        )
    rpy = rpy_of_rotation(frame_along(axes[0]))
    a = {"link": "rod5", "origin": {"xyz": floats(rods[5]), "rpy": rpy}}
    b = {"link": "world", "origin": {"rpy": rpy}}
    document["closures"] = [{"name": "hinge", "kind": "revolute", "a": a, "b": b}]
    document["operational_points"] = [{"name": "corner", "link": "rod3"}]
    return document


def test_an_overconstrained_loop_keeps_its_one_freedom_and_its_energy():
    sim = simulator(bricard())
    state = sim.initial_state()
    assert sim.evaluate(state).space.rank == sim.mechanism.nv - 1 == 4
    states = run(sim, 1.0)
    assert {sim.evaluate(state).space.rank for state in states[::50]} == {4}
    fallen = max(sim.mechanism.energy(state.q, state.v)[0] for state in states)
    assert fallen > 1.0  # J: it does move
    # rk4 at 1 ms, rates of 5 rad/s: (5e-3)^4 = 6e-10 per radian of motion, and a margin.
    assert np.abs(unaccounted(sim, states)).max() < 1e-7 * fallen
