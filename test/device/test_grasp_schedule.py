# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Hands that let go and take hold: when, where from, and with which mass."""

import numpy as np
import pytest

from hapticmech_ros.device import GraspSchedule, grasp_schedule_of
from hapticmech_ros.device.hand import hand_numbers
from hapticmech_ros.device.hand_kernels import OPEN, HandModel, grasp_window
from hapticmech_ros.scene.device import Device
from hapticmech_ros.scene.hand import ArmHand, ConstantWrenchHand, SpringDamperHand, Waypoint
from oracles.devices import NOTHING, PERIOD, body_of, run

DEVICE = Device(mass=0.2, inertia=4e-4, damping=0.3, angular_damping=1e-3)
STAY = (Waypoint(time=0.0),)


def arm(**keys):
    return ArmHand(kind="arm", start_delay=0.0, **{"waypoints": STAY, **keys})


def window_of(schedule, elapsed):
    hand = hand_numbers(None, schedule)
    return grasp_window(HandModel(hand), hand[HandModel.layout.size :], elapsed)


def test_windows_alternate_and_count_the_switches_passed():
    schedule = GraspSchedule(start=0.5, switches=(1.0, 2.0, 3.0))
    times = (0.0, 0.4999, 0.5, 1.4999, 1.5, 2.4999, 2.5, 3.4999, 3.5, 90.0)
    assert [window_of(schedule, time) for time in times] == [
        OPEN,
        OPEN,
        0,
        0,
        OPEN,
        OPEN,
        2,
        2,
        OPEN,
        OPEN,
    ]
    late = GraspSchedule(switches=(1.0, 2.0), holds_first=False)
    assert [window_of(late, time) for time in (0.0, 1.0, 1.5, 2.0)] == [OPEN, 1, 1, OPEN]
    # Sums of periods that round below the time count as there.
    assert window_of(GraspSchedule(switches=(0.3,)), 0.3 - 1e-16) == OPEN


def test_a_hand_whose_first_switch_is_a_grab_does_not_hold_before():
    hand = ConstantWrenchHand(kind="constant_wrench", grab_at=(1.0,), release_at=(2.0,))
    assert grasp_schedule_of(hand) == GraspSchedule(0.25, (1.0, 2.0), holds_first=False)
    assert grasp_schedule_of(arm(mass=1.0, angular_inertia=0.1)) == GraspSchedule(
        0.0, mass=1.0, inertia=0.1
    )


def test_any_hand_pushes_in_its_windows_only():
    hand = ConstantWrenchHand(
        kind="constant_wrench",
        force=(1.0, 0.0, 0.0),
        start_delay=0.01,
        release_at=(0.05,),
        grab_at=(0.08,),
    )
    states = run(body_of(DEVICE, hand), 120)
    for tick, state in enumerate(states):
        holding = 10 <= tick < 60 or tick >= 90
        assert np.array_equal(state.hand_wrench, [float(holding), 0, 0, 0, 0, 0])


def test_a_grab_takes_hold_where_the_device_is_without_a_step():
    hand = SpringDamperHand(
        kind="spring_damper",
        damping=0.0,
        angular_damping=0.0,
        waypoints=STAY,
        start_delay=0.0,
        release_at=(0.02,),
        grab_at=(0.1,),
    )
    push = np.array([0.5, 0.2, 0.0, 0.0, 0.0, 2e-3])
    states = run(body_of(DEVICE, hand), 110, push=push)
    grabbed = states[100]
    assert np.linalg.norm(grabbed.pose.translation - states[0].pose.translation) > 5e-3
    assert np.array_equal(grabbed.anchor.homogeneous, grabbed.pose.homogeneous)
    # A logarithm of a product that is 1 but for rounding.
    assert np.abs(grabbed.hand_wrench).max() < 1e-14
    assert np.array_equal(states[99].hand_wrench, NOTHING)
    for state in states[100:]:
        way = grabbed.pose.translation - state.pose.translation
        assert np.abs(state.hand_wrench[:3] - 300.0 * way).max() < 1e-12


def test_who_takes_hold_anew_holds_from_there():
    hand = SpringDamperHand(kind="spring_damper", waypoints=STAY, start_delay=0.0, grab_at=(0.05,))
    body = body_of(DEVICE, hand)
    away = run(body, 60, push=np.array([0.5, 0, 0, 0, 0, 0]))[-1]
    assert away.window == 1
    alone = body.step(away, NOTHING, None, 0)
    assert alone.window == OPEN
    assert np.array_equal(alone.hand_wrench, NOTHING)
    later = alone
    for tick in range(60):
        later = body.step(later, NOTHING, alone, tick)
    # The second grab, 50 ms later, is at another place than the first.
    assert np.linalg.norm(later.anchor.translation - away.anchor.translation) > 1e-3


def test_an_arm_moves_with_its_mass_while_it_holds():
    hand = arm(
        mass=0.8,
        angular_inertia=6e-4,
        stiffness=1e-9,
        angular_stiffness=1e-9,
        damping=0.0,
        angular_damping=0.0,
        release_at=(0.05,),
    )
    free = Device(mass=0.2, inertia=4e-4)
    push = np.array([1.0, 0.0, 0.0, 0.0, 0.0, 2e-3])
    states = run(body_of(free, hand), 100, push=push)
    # The spring is next to none: momentum is force times time, with the arm and then without.
    assert states[50].twist[0] == pytest.approx(1.0 / 1.0 * 0.05, rel=1e-9)
    assert states[50].twist[5] == pytest.approx(2e-3 / 1e-3 * 0.05, rel=1e-9)
    assert states[100].twist[0] == pytest.approx(0.05 + 1.0 / 0.2 * 0.05, rel=1e-9)
    assert states[100].twist[5] == pytest.approx(0.1 + 2e-3 / 4e-4 * 0.05, rel=1e-9)


def test_its_wrench_on_the_device_is_what_a_sensor_between_them_reads():
    hand = arm(waypoints=(Waypoint(time=0.1, xyz=(0.02, 0.01, 0.0), rotation=(0.0, 0.0, 0.3)),))
    device = DEVICE.model_copy(update={"substeps": 50})
    command = np.array([0.1, -0.2, 0.0, 0.0, 0.0, 1e-3])
    states = run(body_of(device, hand), 200, command)
    mass, damping = np.repeat((0.2, 4e-4), 3), np.repeat((0.3, 1e-3), 3)
    for one, two, three in zip(states[1:], states[2:], states[3:], strict=False):
        # Newton for the device alone, at the middle of two periods by central differences.
        acceleration = (three.twist - one.twist) / (2.0 * PERIOD)
        felt = mass * acceleration + damping * two.twist - command
        # Of second order in T, and half a substep: d³v/dt³ T² / 6 and m dv̇/dt h / 2.
        assert np.abs(two.hand_wrench - felt)[:3].max() < 2e-3
        assert np.abs(two.hand_wrench - felt)[3:].max() < 2e-5
    assert np.abs([state.hand_wrench for state in states]).max() > 0.1


def test_letting_go_and_taking_hold_change_no_speed():
    hand = arm(impedance="firm", release_at=(0.05,), grab_at=(0.1,))
    states = run(body_of(DEVICE, hand), 150, push=np.array([2.0, 0, 0, 0, 0, 0]))
    speeds = np.array([state.twist[0] for state in states])
    # 2 N on 0.2 kg alone, and the firm arm's damper and spring: no impulse anywhere.
    most = (2.0 + 12.9 * np.abs(speeds).max() + 540.0 * 0.02) / 0.2 * PERIOD
    assert np.abs(np.diff(speeds)).max() < most


def test_an_arm_settles_with_its_own_frequency():
    hand = arm(
        mass=0.8,
        stiffness=200.0,
        damping=0.0,
        waypoints=(Waypoint(time=0.0, xyz=(0.01, 0.0, 0.0)),),
    )
    device = Device(mass=0.2, substeps=20)
    states = run(body_of(device, hand), 500)
    found = np.array([(s.pose.translation - states[0].pose.translation)[0] for s in states])
    expected = 0.01 * (1.0 - np.cos(np.sqrt(200.0 / 1.0) * PERIOD * np.arange(501)))
    # Semi-implicit Euler: phase ahead by ω h / 2, of 0.01 m.
    assert np.abs(found - expected).max() < 0.01 * np.sqrt(200.0) * PERIOD / 20
