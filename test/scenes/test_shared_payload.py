# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Two arms on a free-flying base with one payload: what is felt, what is kept, what gives way."""

from functools import cache

import numpy as np
import pytest

from hapticmech_ros import Simulator, analyse, load_scene
from hapticmech_ros.scene import document_of, scene_from_document
from oracles.jacobians import Jacobians

NAME = "shared_payload"


@cache
def document():
    return document_of(load_scene("shared_payload"))


def momentum(mechanism_state):
    return Jacobians(document(), mechanism_state.q).momenta() @ mechanism_state.v


# To the rules' own order: 5e-7 and 5e-11 kg m/s were found at 1 ms, a quarter and a sixteenth of
# them at 0.5 ms, while bodies carry 0.1 kg m/s.
@pytest.mark.parametrize(("integrator", "error"), [("rk2", 1e-6), ("rk4", 1e-10)])
def test_the_arms_move_the_whole_by_nothing(integrator, error):
    """Without a hand momentum and angular momentum stay, whatever joints and dampers do."""
    changed = document_of(load_scene("shared_payload"))
    changed["simulation"]["integrator"] = integrator
    simulator = Simulator(scene_from_document(changed))
    state = simulator.initial_state()
    rng = np.random.default_rng(3)
    for _ in range(50):
        # Motors in all arms' joints push at random.
        efforts = np.concatenate((np.zeros(6), rng.normal(size=14) * 0.05, np.zeros(6)))
        state = simulator.step(state, np.zeros((1, 6)), joint_forces=efforts)
    before = momentum(state)
    assert np.abs(state.v).max() > 0.1
    assert np.abs(before).max() < error
    thrown = simulator.step(state, np.array([[2.0, -1.0, 0.5, 0.02, 0.01, -0.03]]))
    start = momentum(thrown)
    assert np.abs(start[:3]).max() > 1e-3
    end = momentum(simulator.run(thrown, 1000).end)
    assert end == pytest.approx(start, abs=0.1 * error)


def test_a_grasp_that_opens_leaves_the_payload_in_the_other_hand():
    scene = load_scene("shared_payload")
    simulator = Simulator(scene)
    state = simulator.switch(simulator.initial_state(), {"left_grasp": False})
    assert state.active == (False, True)
    one = analyse(simulator.mechanism, state.q, active=state.active).inverse_inertia
    both = analyse(simulator.mechanism, state.q).inverse_inertia
    # What is let go of is not carried: X rises, and there still is no constraint.
    gain = np.linalg.eigvalsh(one - both)
    assert gain.min() > -1e-9 * gain.max()
    assert np.linalg.matrix_rank(one) == 6
    end = simulator.run(state, 200, np.array([[0.5, 0.0, 0.0, 0.0, 0.0, 0.0]])).end
    assert end.active == (False, True)
    assert end.q[21] > state.q[21] + 1e-3
