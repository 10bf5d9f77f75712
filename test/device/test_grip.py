# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A hand's mass behind a grip, against the differential equations of two bodies and springs."""

import numpy as np
import pinocchio as pin
import pytest
from scipy.integrate import solve_ivp

from hapticmech_ros import load_scene
from hapticmech_ros.errors import SceneError
from hapticmech_ros.scene.device import Device
from hapticmech_ros.scene.hand import ArmHand, Waypoint
from oracles.devices import START, body_of
from oracles.devices import run as states_of

COMMAND = np.array([0.4, -0.3, 0.2, 0.004, -0.002, 0.003])
GRIP = {"stiffness": 800.0, "damping": 8.0, "angular_stiffness": 0.7, "angular_damping": 7e-3}
# Where the arm's target is from the start on: some centimetres and half a radian away.
GOAL = {"time": 0.0, "xyz": (0.03, -0.02, 0.01), "rotation": (0.1, 0.4, -0.3)}


def arm(grip=GRIP, waypoints=(GOAL,), **more):
    document = {"kind": "arm", "impedance": "firm", "start_delay": 0.0, "waypoints": waypoints}
    return ArmHand.model_validate({**document, "grip": grip, **more})


def run(hand, ticks, substeps=8, command=COMMAND, planar=False, **device):
    """Return the states at 0, 1, ... ``ticks`` periods of a device that a hand holds."""
    return states_of(body_of(Device(substeps=substeps, **device), hand, planar), ticks, command)


def six(linear, angular):
    return np.repeat((linear, angular), 3)


def spring(stiffness, damping, goal, rate, pose, twist):
    """Return what pulls a body (pose, twist) to another one, (6,)."""
    stretch = pin.log3(goal.rotation @ pose.rotation.T)
    way = np.concatenate((goal.translation - pose.translation, stretch))
    return stiffness * way + damping * (rate - twist)


def exact(hand, device, time):
    """Return poses and twists of device and mass after a time, by an adaptive method of order 8."""
    mass = six(device.mass, device.inertia)
    limb = six(hand.mass, hand.angular_inertia)
    held = pin.SE3(
        pin.exp3(np.array(GOAL["rotation"])) @ START.rotation,
        START.translation + np.array(GOAL["xyz"]),
    )
    grip = hand.grip

    def apart(y):
        bodies = y.reshape(2, 18)
        return [(pin.SE3(b[3:12].reshape(3, 3), b[:3]), b[12:]) for b in bodies]

    def rates(pose, twist, acceleration):
        turning = pin.skew(twist[3:]) @ pose.rotation
        return np.concatenate((twist[:3], turning.ravel(), acceleration))

    def slope(t, y):
        (pose, twist), (place, rate) = apart(y)
        own = spring(
            six(grip.stiffness, grip.angular_stiffness),
            six(grip.damping, grip.angular_damping),
            *(place, rate, pose, twist),
        )
        pulled = spring(
            six(hand.stiffness, hand.angular_stiffness),
            six(hand.damping, hand.angular_damping),
            *(held, np.zeros(6), place, rate),
        )
        drag = six(device.damping, device.angular_damping) * twist
        moved = rates(pose, twist, (COMMAND + own - drag) / mass)
        return np.concatenate((moved, rates(place, rate, (pulled - own) / limb)))

    still = np.concatenate((START.translation, START.rotation.ravel(), np.zeros(6)))
    found = solve_ivp(
        slope, (0.0, time), np.tile(still, 2), method="DOP853", rtol=1e-11, atol=1e-13
    )
    return apart(found.y[:, -1])


def off(states, expected):
    """Return the largest errors of places (m), rotations (rad) and twists of both bodies."""
    last = states[-1]
    found = (last.pose, last.twist), (last.limb, last.limb_twist)
    errors = np.zeros(3)
    for (pose, twist), (right, rate) in zip(found, expected, strict=True):
        turn = pin.log3(pose.rotation @ right.rotation.T)
        now = [np.abs(x).max() for x in (pose.translation - right.translation, turn, twist - rate)]
        errors = np.maximum(errors, now)
    return errors


def test_both_bodies_move_as_their_equations_say_to_second_order():
    hand, damped = arm(), {"damping": 0.4, "angular_damping": 1e-3}
    expected = exact(hand, Device(**damped), 0.15)
    errors = [off(run(hand, 150, n, **damped), expected) for n in (8, 16, 32)]
    orders = np.log2(np.array(errors[:-1]) / np.array(errors[1:]))
    assert np.abs(orders - 2.0).max() < 0.1
    # What moved by centimetres and a third of a radian.
    assert (errors[0] < [2e-7, 1e-5, 5e-4]).all()
    moved = expected[1][0].translation - START.translation
    assert np.abs(moved).max() > 0.02


def test_the_hand_s_wrench_is_that_of_the_grip():
    hand = arm()
    for state in run(hand, 60)[::7]:
        own = spring(
            six(GRIP["stiffness"], GRIP["angular_stiffness"]),
            six(GRIP["damping"], GRIP["angular_damping"]),
            *(state.limb, state.limb_twist, state.pose, state.twist),
        )
        np.testing.assert_allclose(state.reported, own, rtol=1e-12, atol=1e-12)
        np.testing.assert_array_equal(state.reported, state.hand_wrench)


def test_behind_a_stiff_grip_a_mass_is_as_if_it_were_on_the_device():
    rigid = run(arm(grip=None), 100)[-1].pose.translation
    apart = []
    for times in (10.0, 100.0):
        # Of critical damping on both masses together, which leaves no vibration.
        grip = {
            "stiffness": 800.0 * times,
            "damping": 2.0 * np.sqrt(800.0 * times * 0.19),
            "angular_stiffness": 0.7 * times,
            "angular_damping": 2.0 * np.sqrt(0.7 * times * 1.9e-4),
        }
        found = run(arm(grip=grip), 100, substeps=64)[-1].pose.translation
        apart.append(np.abs(found - rigid).max())
    assert apart[1] < 0.2 * apart[0]
    assert apart[1] < 1e-4


def test_what_takes_hold_of_a_moving_device_gives_it_no_impulse():
    hand = arm(waypoints=({"time": 0.0},), release_at=(0.02,), grab_at=(0.05,))
    states = run(hand, 80)
    # From 0.02 to 0.05 s nobody holds.
    assert all(np.array_equal(state.hand_wrench, np.zeros(6)) for state in states[20:50])
    taken = states[50]
    np.testing.assert_array_equal(taken.limb.homogeneous, taken.pose.homogeneous)
    np.testing.assert_array_equal(taken.limb_twist, taken.twist)
    assert np.abs(taken.twist[:3]).max() > 0.02
    # The logarithm of no rotation, which is rounded.
    assert np.abs(taken.hand_wrench).max() < 1e-14
    # Without an impulse the twist goes on as it was: by no more than its rate before.
    gained = np.array(
        [s.twist - t.twist for s, t in zip(states[41:53], states[40:52], strict=True)]
    )
    assert np.abs(gained[9:, :3]).max() < 1.05 * np.abs(gained[:9, :3]).max()


def test_in_a_plane_the_mass_stays_there():
    goal = {"time": 0.1, "xyz": (0.02, -0.01, 0.0), "rotation": (0.0, 0.0, 0.3)}
    last = run(arm(waypoints=(goal,)), 200, planar=True)[-1]
    assert np.array_equal(last.limb_twist[[2, 3, 4]], np.zeros(3))
    assert last.limb.translation[2] == START.translation[2]
    assert np.abs(last.limb.translation - START.translation).max() > 0.005


def test_a_mass_behind_a_grip_has_to_be_one():
    for key in ("mass", "angular_inertia"):
        with pytest.raises(ValueError, match="must be above 0 behind a grip"):
            arm(**{key: 0.0})
    scene = load_scene("five_bar")
    device, still = scene.device, ({"time": 0.0},)
    step = scene.simulation.period / device.substeps
    for key, most in (
        ("damping", device.mass / step),
        ("angular_damping", device.inertia / step),
        ("stiffness", device.mass / step**2),
        ("angular_stiffness", device.inertia / step**2),
    ):
        with pytest.raises(SceneError, match=rf"hand\.grip\.{key}"):
            scene.with_(hand=arm({**GRIP, key: 1.01 * most}, still).model_dump())
        scene.with_(hand=arm({**GRIP, key: 0.99 * most}, still).model_dump())


def test_a_script_has_no_use_for_it():
    with pytest.raises(SceneError, match="grip"):
        load_scene("five_bar").with_(
            hand={"kind": "spring_damper", "grip": GRIP, "waypoints": [GOAL]}
        )
    assert arm().waypoints[0] == Waypoint.model_validate(GOAL)
