# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""State in, state out: same inputs give the same bits, and states are left as they were."""

import numpy as np
import pytest

from oracles.generator import random_mechanism
from oracles.running import run, simulator, with_start


def document():
    sample = random_mechanism(1)
    return with_start(sample.document, sample.q, sample.v)


def bits(state):
    return (state.q.tobytes(), state.v.tobytes(), state.time, state.active, state.account)


def test_one_simulator_may_serve_several_states():
    sim, other = simulator(document()), simulator(document())
    expected = run(sim, 0.02)
    first, wrenches = other.initial_state(), np.zeros((2, 6))
    far = other.step(first, np.ones((2, 6)))
    state = first
    for reached in expected[1:]:
        far = other.step(far, np.ones((2, 6)))
        state = other.step(state, wrenches)
        assert bits(state) == bits(reached)


def test_states_are_read_only_and_left_alone():
    sim = simulator(document())
    state = sim.initial_state()
    before = bits(state)
    later = sim.step(state, np.zeros((2, 6)))
    assert bits(state) == before
    for array in (state.q, state.v, later.q, later.v):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 0.0
    assert later.time == sim.period
