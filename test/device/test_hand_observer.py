# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""F_h at a device that somebody else drives: from its motion and its actuators alone."""

import numpy as np
import pinocchio as pin
import pytest

from hapticmech_ros.device import ImpedanceDevice
from hapticmech_ros.device.real_device import LONGEST_PERIOD_S, HandObserver, TwistEstimate
from hapticmech_ros.loading import load_scene
from hapticmech_ros.scene.device import Device
from hapticmech_ros.scene.hand import ConstantWrenchHand

MASS, INERTIA = 0.3, 3e-4
BODY = np.array([MASS] * 3 + [INERTIA] * 3)
PUSH = np.array([0.5, -0.3, 0.2, 1e-3, -2e-3, 3e-3])


def device(**changes):
    given = {"mass": MASS, "inertia": INERTIA, "force_sensor": "estimated", "damping": 0.4}
    return Device(**(given | changes))


def test_it_is_what_the_simulated_device_reports_at_its_own_period():
    """The same equation, of measured twists and of what actuators did."""
    period, found = 1e-3, device(actuator_bandwidth=150.0)
    hand = ConstantWrenchHand(kind="constant_wrench", force=tuple(PUSH[:3]), start_delay=0.0)
    simulated = ImpedanceDevice(found, period, False, hand)
    observer = HandObserver(found, False)
    state = held = simulated.at_rest(pin.SE3.Identity(), held=True)
    observer.at(0.0, state.measured_twist, np.zeros(6))
    rng, worst = np.random.default_rng(1), 0.0
    for tick in range(300):
        command = 0.2 * rng.standard_normal(6) * (1, 1, 1, 0.01, 0.01, 0.01)
        before = state.applied.copy()
        state = simulated.step(state, command, held, tick)
        # The mean over the period of what lags exponentially between both ends.
        share = (1.0 - np.exp(-2.0 * np.pi * 150.0 * period)) / (2.0 * np.pi * 150.0 * period)
        mean = command + share * (before - command)
        estimate = observer.at((tick + 1) * period, state.measured_twist, mean)
        worst = max(worst, np.abs(estimate - state.reported).max())
    assert worst < 1e-12
    # Damping counts by the mean of both ends of a period: b Δv / 2 at most.
    assert estimate[:3] == pytest.approx(PUSH[:3], abs=1.5e-4)


@pytest.mark.parametrize("period", [1e-3, 5e-3, 0.02])
def test_a_constant_push_is_found_at_any_rate(period):
    """Of a body that accelerates, with the sign of the push; the actuators do something else."""
    observer, twist, applied = HandObserver(device(damping=0.0), False), np.zeros(6), -0.4 * PUSH
    observer.at(0.0, twist, applied)
    for tick in range(1, 1 + round(0.3 / period)):
        twist = twist + period * (PUSH + applied) / BODY
        found = observer.at(tick * period, twist, applied)
    # What the low-pass of 30 Hz leaves after so long: e^-56.
    assert found == pytest.approx(PUSH, rel=1e-9)


def test_a_hand_that_holds_still_what_actuators_push_is_opposite_to_them():
    observer, applied = HandObserver(device(), False), np.array([1.0, 0, 0, 0, 0, 0.01])
    for tick in range(500):
        found = observer.at(1e-3 * tick, np.zeros(6), applied)
    assert found == pytest.approx(-applied, abs=1e-9)


def test_the_driver_lifts_the_weight_and_a_plane_has_three_directions():
    heavy = device(gravity_load=(0.0, -0.6, 0.0))
    observer = HandObserver(heavy, True)
    for tick in range(500):
        found = observer.at(1e-3 * tick, np.zeros(6), np.ones(6))
    assert found == pytest.approx([-1.0, -1.0, 0.0, 0.0, 0.0, -1.0], abs=1e-9)


@pytest.mark.parametrize("later", [LONGEST_PERIOD_S + 1e-3, 0.0, -1.0])
def test_samples_that_have_nothing_to_do_with_each_other_begin_anew(later):
    observer = HandObserver(device(), False)
    for tick in range(200):
        before = observer.at(1e-3 * tick, np.zeros(6), np.ones(6))
    assert np.abs(before).max() > 0.9
    assert (observer.at(0.199 + later, np.zeros(6), np.ones(6)) == 0.0).all()


def test_twists_come_from_poses():
    """Of a steady screw, beyond the filter's time; turning by a revolution and more."""
    twist, period = np.array([0.1, -0.2, 0.05, 2.0, -3.0, 1.0]), 5e-3
    estimate, pose = TwistEstimate(100.0), pin.SE3.Identity()
    for tick in range(500):
        found = estimate.at(period * tick, pose)
        turned = pin.exp3(period * twist[3:]) @ pose.rotation
        pose = pin.SE3(turned, pose.translation + period * twist[:3])
    assert found == pytest.approx(twist, rel=1e-9)
    estimate.forget()
    assert (estimate.at(3.0, pose) == 0.0).all()


def test_presets_have_no_sensor_and_so_an_observer():
    found = Device(preset="touch")
    assert found.force_sensor == "estimated"
    assert HandObserver(found, False).at(0.0, np.zeros(6), np.zeros(6)) == pytest.approx(0.0)
    assert load_scene("five_bar").device.force_sensor == "measured"
