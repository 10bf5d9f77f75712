# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""States of the mechanism that are late by whole periods: what they have not been moved by yet."""

import numpy as np

from hapticmech_ros.control import ControlArchitecture
from hapticmech_ros.control.rendering_controller import ControllerInput, RenderingController
from hapticmech_ros.loading import load_scene
from hapticmech_ros.numerics.layout import DeviceSample, OperationalModelSample
from oracles.running import varied

PERIOD = 1e-3
PUSHES = (0.3, -0.2, 0.5, 0.1, 0.4)


def answers(delay, late=0.0, known=5):
    """Return the wrenches (6, 6) that answer the last of some samples, whose state is late, s.

    Args:
        delay: periods until the mechanism is moved by what it is told.
        late: of the last sample's state, s.
        known: how many samples there are.
    """
    # What the mechanism is told is F_h alone, whatever was predicted before.
    gains = {"position_channel": {"to_mechanism": 0.0}}
    scene = varied(load_scene("five_bar"), controller=gains)
    side = RenderingController(ControlArchitecture(scene), PERIOD, scene.connection, delay)
    model = np.zeros(OperationalModelSample.layout.size)
    model[OperationalModelSample.layout.slice("quaternion").stop - 1] = 1.0
    model[OperationalModelSample.layout.slice("inverse_inertia")] = np.diag(
        [9.0, 7.0, 0, 0, 0, 800.0]
    ).ravel()
    model[OperationalModelSample.layout.slice("twist")] = [0.02, 0.01, 0.0, 0.0, 0.0, 0.1]
    found = None
    for tick, push in enumerate(PUSHES[-known:]):
        device = np.zeros(DeviceSample.layout.size)
        device[DeviceSample.layout.slice("quaternion").stop - 1] = 1.0
        device[DeviceSample.layout.start("hand_wrench")] = push
        # Long after the ramp of a start.
        time = 100.0 + tick * PERIOD
        if found is None:
            clutch = side.control.engage(0.0, device, model, 0.0)
        apart_ns = round(1e9 * late) if tick == known - 1 else 0
        inputs = ControllerInput(time, tick, device, model, apart_ns, 1_000_000)
        found = side.tick(inputs, clutch, corrects=True).wrenches
    return found


def test_a_state_that_is_late_by_a_period_lacks_one_command_more():
    assert np.array_equal(answers(1, late=PERIOD), answers(2))
    assert np.array_equal(answers(1, late=3.0 * PERIOD), answers(4))
    # Which is not what twists alone say.
    assert np.abs(answers(1, late=PERIOD) - answers(1)).max() > 1e-3


def test_a_state_that_is_newer_than_its_sample_lacks_none():
    assert np.array_equal(answers(1, late=-PERIOD), answers(0))


def test_what_was_not_told_yet_is_missing_nowhere():
    assert np.isfinite(answers(1, late=5.0 * PERIOD, known=2)).all()
    assert np.array_equal(answers(1, late=PERIOD, known=2), answers(2, known=2))
    assert np.array_equal(answers(1, late=PERIOD, known=1), answers(2, known=1))
