# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""G corrects a command for another hand wrench exactly, wherever no limit is met."""

import numpy as np
import pytest

from hapticmech_ros import load_scene
from hapticmech_ros.control.measurements import (
    InFlight,
    predicted_twist,
)
from hapticmech_ros.numerics.layout import OperationalModelSample
from oracles.controllers import corrected_answers


@pytest.mark.parametrize("beta", [0.0, 0.4, 1.0])
@pytest.mark.parametrize("time", [0.03, 5.0])
@pytest.mark.parametrize("carried", [None, np.full(6, 0.01)])
@pytest.mark.parametrize("name", ["five_bar", "spatial_arm", "door"])
def test_it_is_the_answer_to_the_other_wrench(name, carried, time, beta):
    gains = {"joint_constraint": {"feedforward": beta}, "force_channel": {"device_feedback": -0.2}}
    rng = np.random.default_rng(1)
    hands = rng.normal(scale=0.3, size=(2, 6)) * ([1.0] * 3 + [0.02] * 3)
    twist = rng.normal(scale=0.01, size=6)
    states = [(np.zeros(6), twist, hand) for hand in hands]
    # Half of the springs at 0.03 s; after another grasp three quarters of all.
    old, new, found = corrected_answers(load_scene(name), gains, time, states, carried)
    assert np.abs(found - new).max() < 1e-13
    # And it does correct something.
    assert np.abs(new - old).max() > 1e-3


@pytest.mark.parametrize("held_by", ["contact", "gravity"])
def test_nothing_is_foreseen_of_a_mechanism_that_stands_still_under_a_push(held_by):
    """What is in flight is no motion where something else holds against it."""
    rng = np.random.default_rng(2)
    root = rng.normal(size=(6, 6))
    x, push, twist = root @ root.T, rng.normal(size=6), rng.normal(size=6)
    in_flight = InFlight(1e-3, 1e-3 * push)
    free = -x @ push if held_by == "gravity" else np.zeros(6)
    contact = -push if held_by == "contact" else np.zeros(6)
    model = OperationalModelSample()
    model.fill(twist=twist, inverse_inertia=x, free_acceleration=free, contact=contact)
    still = predicted_twist(model, in_flight)
    assert np.abs(still - twist).max() < 1e-15 * np.abs(x).max()
    model.fill(free_acceleration=np.zeros(6), contact=np.zeros(6))
    moving = predicted_twist(model, in_flight)
    assert moving == pytest.approx(twist + 1e-3 * x @ push, rel=1e-12)
