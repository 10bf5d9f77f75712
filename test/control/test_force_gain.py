# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""G corrects a command for another hand wrench exactly, wherever no limit is met."""

import numpy as np
import pytest

from hapticmech_ros import Session, load_scene
from hapticmech_ros.control import ControlArchitecture, DeviceMeasurement, PointMeasurement
from hapticmech_ros.control.clutch import engage
from hapticmech_ros.control.loop_layout import HandMemory
from hapticmech_ros.control.measurements import (
    InFlight,
    flat_device,
    operational_model_of,
    predicted_twist,
)
from hapticmech_ros.control.passivity import corrected
from oracles.controllers import local_model
from oracles.running import varied

# Of a hand whose wrench was never measured before: nothing is carried on.
NO_MEMORY = HandMemory().values


@pytest.mark.parametrize("beta", [0.0, 0.4, 1.0])
@pytest.mark.parametrize("time", [0.03, 5.0])
@pytest.mark.parametrize("carried", [None, np.full(6, 0.01)])
@pytest.mark.parametrize("name", ["five_bar", "spatial_arm", "door"])
def test_it_is_the_answer_to_the_other_wrench(name, carried, time, beta):
    scene = load_scene(name)
    gains = {"joint_constraint": {"feedforward": beta}, "force_channel": {"device_feedback": -0.2}}
    control = ControlArchitecture(varied(scene, controller=gains))
    sample = Session(scene).tick()
    model, pose = operational_model_of(sample.analysis), sample.point.pose
    # Half of the springs at 0.03 s; after another grasp three quarters of all.
    clutch = engage(0.0, pose, pose, 0.04, carried)
    rng = np.random.default_rng(1)
    first, second = rng.normal(scale=0.3, size=(2, 6)) * ([1.0] * 3 + [0.02] * 3)
    twist = rng.normal(scale=0.01, size=6)

    def measured(hand):
        return DeviceMeasurement(pose, twist, hand)

    seen = PointMeasurement(pose, twist, np.zeros(6))

    def answer(hand):
        return control.compute(time, clutch, measured(hand), seen, model).device

    gains = local_model(control, time, clutch, model, seen)
    then, now = flat_device(measured(first)), flat_device(measured(second))
    found = corrected(answer(first), gains, then, now, NO_MEMORY, 1e-3)
    assert np.abs(found - answer(second)).max() < 1e-13
    # And it does correct something.
    assert np.abs(answer(second) - answer(first)).max() > 1e-3


@pytest.mark.parametrize("held_by", ["contact", "gravity"])
def test_nothing_is_foreseen_of_a_mechanism_that_stands_still_under_a_push(held_by):
    """What is in flight is no motion where something else holds against it."""
    rng = np.random.default_rng(2)
    root = rng.normal(size=(6, 6))
    x, push, twist = root @ root.T, rng.normal(size=6), rng.normal(size=6)
    in_flight = InFlight(1e-3, 1e-3 * push)
    free = -x @ push if held_by == "gravity" else np.zeros(6)
    contact = -push if held_by == "contact" else np.zeros(6)
    still = predicted_twist(twist, x, free, contact, in_flight)
    assert np.abs(still - twist).max() < 1e-15 * np.abs(x).max()
    moving = predicted_twist(twist, x, np.zeros(6), np.zeros(6), in_flight)
    assert moving == pytest.approx(twist + 1e-3 * x @ push, rel=1e-12)
