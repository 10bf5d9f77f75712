# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The hand's wrench without a sensor: found without bias, late as its bandwidth says."""

import numpy as np
import pytest

from hapticmech_ros.scene.device import Device
from oracles.devices import PERIOD, body_of, run

PUSH = np.array([0.4, -0.2, 0.1, 1e-3, 0.0, -2e-3])
KNOWN = {
    "damping": 0.3,
    "angular_damping": 5e-4,
    "gravity_load": (0.0, 0.2, -0.6),
    "force_sensor": "estimated",
}
COMMAND = np.array([-0.1, 0.3, 0.0, 0.0, 1e-3, 1e-3])


@pytest.mark.parametrize("bandwidth", [5.0, 30.0])
def test_a_constant_wrench_is_found_along_a_first_order_rise(bandwidth):
    device = Device(observer_bandwidth=bandwidth, substeps=20, **KNOWN)
    states = run(body_of(device), 400, COMMAND, PUSH)
    for tick, state in enumerate(states):
        rise = -np.expm1(-2.0 * np.pi * bandwidth * tick * PERIOD)
        # Known damping at a period's mean speed: what Euler's substeps leave is b v̇ h / 2, h the
        # substep, of PUSH some 1e-5.
        assert np.abs(state.reported - rise * PUSH).max() < 1e-4 * np.abs(PUSH).max()
        assert np.array_equal(state.hand_wrench, np.zeros(6))


@pytest.mark.parametrize("bandwidth", [0.0, 60.0])
def test_what_actuators_give_is_not_taken_for_the_hand(bandwidth):
    device = Device(actuator_bandwidth=bandwidth, **KNOWN)
    # b v̇ h / 2 at up to 2 m/s² and 3 rad/s², h the substep of 0.25 ms.
    bound = np.repeat((0.3 * 2.0, 5e-4 * 3.5), 3) * 1.25e-4
    for state in run(body_of(device), 300, COMMAND):
        assert (np.abs(state.reported) < bound).all()


def test_encoder_steps_leave_the_mean_unbiased():
    device = Device(
        position_resolution=1e-5, angle_resolution=1e-3, observer_bandwidth=5.0, **KNOWN
    )
    expected = PUSH.copy()
    expected[0] += 0.2
    states = run(body_of(device), 1500, -PUSH, expected)
    mean = np.mean([state.reported for state in states[500:]], axis=0)
    # Over 1 s the momentum is known to its noise, some counts a period after the filter.
    noise = np.repeat((0.3 * 1e-5, 3e-4 * 1e-3), 3) / PERIOD / 1.0 * 2.0
    assert (np.abs(mean - expected) < noise + 1e-3 * np.abs(expected)).all()


@pytest.mark.parametrize("frequency", [1.0, 5.0, 20.0])
def test_a_sinusoid_lags_as_predicted(frequency):
    bandwidth, ticks = 20.0, 2000
    device = Device(observer_bandwidth=bandwidth, force_sensor="estimated", substeps=10)
    speed = 2.0 * np.pi * frequency
    states = run(body_of(device), ticks, push=lambda time: [np.sin(speed * time), 0, 0, 0, 0, 0])
    found = np.array([state.reported[0] for state in states])[1000:ticks]
    times = np.arange(1000, ticks) * PERIOD
    response = 2.0 * np.mean(found * np.exp(-1j * speed * times)) * 1j
    # Over whole turns. The exact step: (1 - a) / (z - a), a = e^(-ω T), of samples held.
    kept, z = np.exp(-2.0 * np.pi * bandwidth * PERIOD), np.exp(1j * speed * PERIOD)
    assert abs(response - (1.0 - kept) / (z - kept)) < 1e-9
    late = np.arctan(frequency / bandwidth) + 0.5 * speed * PERIOD
    # Half a period besides the low-pass, to second order in ω T.
    assert -np.angle(response) == pytest.approx(late, abs=2e-3)


def test_friction_is_taken_for_the_hand_but_for_its_compensated_share():
    for share in (0.0, 0.6):
        device = Device(
            coulomb_friction=0.2, force_sensor="estimated", compensation={"friction": share}
        )
        push = np.array([0.5, 0, 0, 0, 0, 0])
        end = run(body_of(device), 500, push=push)[-1]
        assert end.reported[0] == pytest.approx(0.5 - (1.0 - share) * 0.2, rel=1e-9)


def test_what_is_published_is_what_the_sensor_says():
    for sensor in ("measured", "estimated", "absent"):
        body = body_of(Device(force_sensor=sensor))
        end = run(body, 30, push=PUSH)[-1]
        assert np.array_equal(end.published[13:19], end.reported)
        assert body.sensed(PUSH).any() == (sensor == "measured")
        assert end.reported.any() == (sensor == "estimated")
