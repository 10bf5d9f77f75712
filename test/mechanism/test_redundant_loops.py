# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Redundant closures keep simulating, also where only the closed positions make them redundant.

Off the closed positions by phi, such rows are independent by about phi: a Runge-Kutta stage there
must not take them for closures of their own.
"""

import numpy as np
import pytest

from oracles.generator import random_mechanism
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
