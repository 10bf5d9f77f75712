# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The simulated device against what a rigid body does; its actuators and its encoders."""

from itertools import pairwise

import numpy as np
import pinocchio as pin
import pytest

from hapticmech_ros.device import GraspSchedule, ImpedanceDevice
from hapticmech_ros.scene.device import Device
from oracles.devices import NOTHING, PERIOD, START
from oracles.devices import run as states_of


def no_hand(elapsed, pose, twist, held):
    return np.zeros(6)


def pushing(wrench):
    return lambda elapsed, pose, twist, held: np.asarray(wrench, dtype=float)


def run(device, ticks, hand=no_hand, command=NOTHING, twist=None):
    """Return the states at 0, 1, ..., ``ticks`` periods, of a hand that is a law."""
    body = ImpedanceDevice(device, PERIOD, False, law=hand)
    start = body.at_rest(START, held=True)
    return states_of(
        body, ticks, command, start=start if twist is None else start.replaced(twist=twist)
    )


def test_a_free_device_under_a_constant_force_falls_by_the_book():
    device = Device(mass=0.25, substeps=4)
    force = np.array([1.0, -2.0, 0.5])
    end = run(device, 400, pushing([*force, 0, 0, 0]))[-1]
    time = 0.4
    assert np.abs(end.twist[:3] - force / 0.25 * time).max() < 1e-12
    way = end.pose.translation - START.translation
    assert np.abs(way - 0.5 * force / 0.25 * time**2).max() < 1e-12
    assert np.abs(end.pose.rotation - START.rotation).max() < 1e-15


def test_a_constant_torque_turns_it_about_the_axis_in_the_world():
    device = Device(inertia=1e-3, substeps=4)
    torque = np.array([0.002, 0.001, -0.002])
    end = run(device, 300, pushing([0, 0, 0, *torque]))[-1]
    time = 0.3
    assert np.abs(end.twist[3:] - torque / 1e-3 * time).max() < 1e-12
    angle = 0.5 * torque / 1e-3 * time**2
    # 2400 products of rotations, each rounded.
    assert np.abs(end.pose.rotation - pin.exp3(angle) @ START.rotation).max() < 1e-12


def test_damping_decays_exponentially_and_with_second_order():
    errors = []
    for substeps in (5, 10, 20):
        device = Device(
            mass=0.5, damping=4.0, inertia=2e-3, angular_damping=0.01, substeps=substeps
        )
        end = run(device, 200, twist=[1.0, 0, 0, 0, 0, 1.0])[-1]
        rates = np.array([4.0 / 0.5, 0.01 / 2e-3])
        errors.append(np.abs(end.twist[[0, 5]] - np.exp(-rates * 0.2)))
    orders = np.log2(np.array(errors[:-1]) / np.array(errors[1:]))
    assert np.abs(orders - 2.0).max() < 0.02
    # The damper acts by the mean of both ends' speeds: relative error rate³ t h² / 12.
    bound = rates**3 * 0.2 * (PERIOD / 20) ** 2 / 12.0 * np.exp(-rates * 0.2)
    assert (errors[-1] < 1.05 * bound).all()


def test_hand_and_actuators_add_up():
    push, command = np.array([0.3, 0, 0, 0, 0.01, 0]), np.array([-0.1, 0.2, 0, 0.01, 0, 0])
    together = run(Device(), 10, pushing(push), command)[-1]
    alone = run(Device(), 10, pushing(push + command))[-1]
    assert np.abs(together.twist - alone.twist).max() < 1e-15


def test_the_hand_is_not_saturated():
    device = Device(mass=1.0, force_limit=2.0)
    end = run(device, 1, pushing([50.0, 0, 0, 0, 0, 0]))[-1]
    assert abs(end.twist[0] / PERIOD - 50.0) < 1e-11


@pytest.mark.parametrize("substeps", [1, 4, 7])
def test_a_command_is_held_over_the_period_while_the_hand_acts_all_through_it(substeps):
    device = Device(mass=0.5, substeps=substeps)
    seen = []

    def watching(elapsed, pose, twist, held):
        seen.append(elapsed)
        return np.zeros(6)

    command = np.array([1.0, 0, 0, 0, 0, 0])
    end = run(device, 2, watching, command)[-1]
    # The impulse is command times period, however the period is divided.
    assert abs(end.twist[0] - 2.0 * PERIOD / 0.5) < 1e-15
    # At rest; then, in each period, at its start, in the middle of each substep, and at its end.
    asked = np.array(seen[1:]).reshape(2, substeps + 2)
    starts = np.array([0.0, PERIOD])
    assert seen[0] == 0.0
    assert np.abs(asked[:, 0] - starts).max() < 1e-15
    assert np.abs(asked[:, -1] - starts - PERIOD).max() < 1e-15
    middles = (np.arange(substeps) + 0.5) * PERIOD / substeps
    assert np.abs(asked[:, 1:-1] - starts[:, None] - middles).max() < 1e-15


@pytest.mark.parametrize("mass", [0.0, 1.5])
def test_what_a_hand_does_within_a_period_acts_by_its_mean_and_is_told_in_time(mass):
    """A hand that moves to and fro: speed and F_h converge with the second order of substeps."""
    size, rate, periods = 2.0, 2.0 * np.pi * 20.0, 40
    schedule = GraspSchedule(start=0.0, switches=(), mass=mass, inertia=0.0)

    def swinging(elapsed, pose, twist, held):
        return np.array([size * np.cos(rate * elapsed), 0, 0, 0, 0, 0])

    time, errors = periods * PERIOD, []
    for substeps in (1, 2, 4):
        device = Device(mass=0.5, substeps=substeps)
        body = ImpedanceDevice(device, PERIOD, False, law=swinging, schedule=schedule)
        state = states_of(body, periods)[-1]
        acceleration = size * np.cos(rate * time) / (0.5 + mass)
        speed = size / rate * np.sin(rate * time) / (0.5 + mass)
        found = np.array([state.twist[0], state.hand_wrench[0]])
        errors.append(np.abs(found - (speed, 0.5 * acceleration)))
    assert (errors[0] < 2e-3).all()
    for coarse, fine in pairwise(errors):
        # What is told of a hand without a mass is exact.
        assert coarse[0] / fine[0] == pytest.approx(4.0, rel=0.02)
        assert fine[1] < max(0.3 * coarse[1], 1e-14)


def test_ideal_encoders_say_the_truth_to_the_bit():
    for state in run(Device(), 5, pushing(np.ones(6))):
        assert np.array_equal(state.measured_twist, state.twist)
        assert np.array_equal(state.measured_pose.homogeneous, state.pose.homogeneous)


def test_encoders_read_whole_steps_no_further_off_than_half_a_step():
    fine, turn = 1e-4, 2e-3
    device = Device(position_resolution=fine, angle_resolution=turn)
    for state in run(device, 200, pushing([0.2, -0.1, 0.3, 1e-4, 0, 2e-4])):
        read = state.measured_pose
        counts = read.translation / fine
        assert np.abs(counts - np.round(counts)).max() < 1e-9
        assert np.abs(read.translation - state.pose.translation).max() <= 0.5 * fine + 1e-15
        counts = pin.log3(read.rotation) / turn
        # log and exp cancel to 1e-15 rad, in units of a step.
        assert np.abs(counts - np.round(counts)).max() < 1e-9
        off = pin.log3(read.rotation) - pin.log3(state.pose.rotation)
        assert np.abs(off).max() <= 0.5 * turn + 1e-12


def test_the_velocity_estimate_is_the_true_mean_with_steps_of_one_count():
    fine, speed, cut_off = 1e-5, 0.05, 20.0
    device = Device(position_resolution=fine, velocity_filter=cut_off)
    states = run(device, 1200, twist=[speed, 0, 0, 0, 0, 0])
    estimate = np.array([state.measured_twist[0] for state in states])
    settled = estimate[200:]  # 200 ms are 25 time constants of a 20 Hz filter
    # Over 1 s the encoder is off by one count at most.
    assert abs(settled.mean() - speed) < fine / 1.0 + 1e-12
    gain = 2.0 * np.pi * cut_off * PERIOD
    gain /= 1.0 + gain
    # One count in one period is fine / PERIOD m/s, of which the filter lets `gain` through.
    assert np.abs(settled - speed).max() < gain * fine / PERIOD * 1.01
    assert estimate[0] == 0.0
    # First-order rise: 1 - (1 - gain)^n, to one count.
    rise = speed * (1.0 - (1.0 - gain) ** np.arange(estimate.size))
    assert np.abs(estimate - rise).max() < gain * fine / PERIOD * 1.01


def test_a_standing_device_seems_to_stand_with_coarse_encoders():
    device = Device(position_resolution=1e-2, angle_resolution=0.1)
    for state in run(device, 5):
        # A rotation times its own inverse is off by 1e-16, divided by 1 ms and filtered.
        assert np.abs(state.measured_twist).max() < 1e-12


def test_a_planar_device_never_leaves_the_plane():
    upright = pin.SE3(pin.exp3(np.array([0, 0, 0.4])), np.array([0.1, 0.2, 0.0]))
    body = ImpedanceDevice(Device(), PERIOD, planar=True)
    state = body.at_rest(upright)
    for _ in range(100):
        state = body.step(state, np.full(6, 0.1), None, 0, np.ones(6))
        assert np.array_equal(state.twist[2:5], np.zeros(3))
        assert state.pose.translation[2] == 0.0
        # The axis out of the plane is kept to the bit: no product ever mixes it.
        assert np.array_equal(state.pose.rotation[:, 2], [0.0, 0.0, 1.0])
    assert state.twist[0] > 0.0
    assert state.twist[5] > 0.0


def test_others_push_besides_the_hand_and_are_no_part_of_its_wrench():
    own, others = np.array([0.3, 0, 0, 0, 0.01, 0]), np.array([-0.1, 0.2, 0, 0.01, 0, 0])
    body = ImpedanceDevice(Device(), PERIOD, False, law=pushing(own))
    start = body.at_rest(START, held=True)
    state = body.step(start, NOTHING, start, 0, others)
    expected = run(Device(), 1, pushing(own + others))[-1]
    assert np.abs(state.twist - expected.twist).max() < 1e-15
    assert np.array_equal(state.hand_wrench, own)
    alone = body.step(start, NOTHING, None, 0, others)
    assert np.abs(alone.twist - run(Device(), 1, pushing(others))[-1].twist).max() < 1e-15
    assert np.array_equal(alone.hand_wrench, np.zeros(6))
