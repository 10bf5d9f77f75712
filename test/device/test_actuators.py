# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Actuators: their lag is a first-order one exactly, and what has none gives no torque."""

import numpy as np
import pytest

from hapticmech_ros.scene.device import Compensation, Device
from oracles.devices import PERIOD, body_of, run

COMMAND = np.array([1.0, -2.0, 0.5, 0.01, 0.0, -0.02])


@pytest.mark.parametrize("substeps", [1, 3])
@pytest.mark.parametrize("bandwidth", [2.0, 50.0, 5000.0])
def test_a_step_of_the_command_is_followed_by_a_first_order_lag(substeps, bandwidth):
    device = Device(actuator_bandwidth=bandwidth, substeps=substeps)
    states = run(body_of(device), 60, COMMAND)
    rate = 2.0 * np.pi * bandwidth
    for tick, state in enumerate(states):
        expected = -np.expm1(-rate * tick * PERIOD) * COMMAND
        assert np.abs(state.applied - expected).max() < 1e-13
    # The impulse is the integral of that; translation only, which is without damping.
    time = 60 * PERIOD
    impulse = COMMAND * (time + np.expm1(-rate * time) / rate)
    mass = np.repeat((device.mass, device.inertia), 3)
    assert np.abs(mass * states[-1].twist - impulse).max() < 1e-13


def test_it_lags_behind_the_limit_not_behind_what_was_asked():
    device = Device(actuator_bandwidth=20.0, force_limit=2.0, torque_limit=0.5)
    end = run(body_of(device), 300, np.array([30.0, 0, -40.0, 0, 6.0, 8.0]))[-1]
    expected = np.array([1.2, 0, -1.6, 0, 0.3, 0.4])
    # exp(-2 π 20 · 0.3) is 4e-17.
    assert np.abs(end.applied - expected).max() < 1e-14


def test_without_actuators_of_rotation_the_handle_turns_freely():
    body = body_of(Device(actuated="translation"))
    push = np.array([0.0, 0.0, 0.0, 0.0, 0.0, 1e-3])
    end = run(body, 50, COMMAND, push)[-1]
    assert np.array_equal(end.applied, [*COMMAND[:3], 0.0, 0.0, 0.0])
    assert end.twist[5] == pytest.approx(1e-3 / 3e-4 * 0.05, rel=1e-11)
    assert np.array_equal(end.twist[3:5], [0.0, 0.0])


def test_actuators_that_are_off_give_nothing_compensation_included():
    compensation = Compensation(gravity=True, friction=0.9)
    device = Device(gravity_load=(0.0, 0.0, -1.0), damping=0.1, compensation=compensation)
    states = run(body_of(device), 20, None)
    assert all(np.array_equal(state.applied, np.zeros(6)) for state in states)
    assert states[-1].twist[2] < -0.05
