# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The transparency oracle on the sampled, delayed loop: exact as the period goes to zero.

A device and a mechanism of the same Λ, C2 = C3 = 1 and C_m = C_s: then (sΛ + C_m + C_s)(V_h - V_e)
is 0 and sΛ (V_h + V_e)/2 is F_h - F_e, so drift decays as a damped oscillation and the hand feels Λ
and what pushes on the mechanism. That is the loop without delay; a session has one of a period, and
holds. Of the hand's own wrench, which the device carries on to the middle of the period, what is
left is of second order in the period; of what others do to the mechanism, which it learns of later,
of first order.
"""

import numpy as np
import pinocchio as pin
import pytest

from hapticmech_ros.analysis.touch import fine_times, means_of, scripted
from hapticmech_ros.scene import scene_from_document
from hapticmech_ros.session import Session
from oracles.sessions import take_hold_beside
from sampling import only_long

MASS, STIFFNESS, DAMPING = 0.5, 100.0, 4.0
# Of a wall that holds the mechanism from outside, N/m and N s/m.
WALL = (100.0, 5.0)
PERIODS = (4e-3, 2e-3, 1e-3, 5e-4, *only_long(2.5e-4))
FREQUENCIES_HZ = np.array([1.0, 2.0, 5.0, 10.0, 30.0])
# So that motions die away by exp(-10) that the push began with: they decay by 5 per s at least.
SETTLING_S, WINDOW_S = 2.0, 1.0
# The first order's share of an error is 1 less about half of what the loop's 2.5 periods turn a
# wave by, which takes 0.15 off the order up to 10 Hz at 4 ms and, at 30 Hz, from 0.5 ms on.
OWN_ORDER, ORDER, TOLERANCE = 2.0, 1.0, 0.15
OPEN = {"force_slew": 1e9, "torque_slew": 1e9, "start_ramp": 0.0}


def block(period):
    """Return a block on a rail, held by a device as heavy as itself."""
    matter = {"ixx": 1e-3, "iyy": 1e-3, "izz": 1e-3}
    rail = {"name": "rail", "type": "prismatic", "axis": [1, 0, 0]}
    channel = {"stiffness": STIFFNESS, "damping": DAMPING}
    return scene_from_document(
        {
            "format": "hapticmech-scene/1",
            "name": "block",
            "task_space": "planar",
            "gravity": [0, 0, 0],
            "links": [
                {
                    "name": "block",
                    "parent": "world",
                    "joint": rail,
                    "inertial": {"mass": MASS, "inertia": matter},
                }
            ],
            "operational_points": [{"name": "grip", "link": "block"}],
            "simulation": {"period": period, "integrator": "rk4"},
            # The controllers' law, without what the envelope makes of its beginning.
            "device": {"mass": MASS, "inertia": 1e-3, "safety": OPEN},
            "controller": {"engagement_ramp": 0.0, "position_channel": channel},
            "hand": {"kind": "constant_wrench"},
        }
    )


def along_x(value):
    return np.array([value, 0.0, 0.0, 0.0, 0.0, 0.0])


def lines(values, period):
    """Return complex amplitudes over the last second, without what drifts."""
    last = values[-round(WINDOW_S / period) :]
    turns = 2.0 * np.pi * period * np.arange(last.size)
    columns = [np.ones(last.size), turns]
    for frequency in FREQUENCIES_HZ:
        columns += [np.cos(frequency * turns), np.sin(frequency * turns)]
    fit = np.linalg.lstsq(np.array(columns).T, last, rcond=None)[0][2:].reshape(-1, 2)
    return fit[:, 0] - 1j * fit[:, 1]


def felt(period, wall):
    """Return felt impedance: means of the hand's push over periods, and of the velocity."""
    periods = round((SETTLING_S + WINDOW_S) / period)
    time = fine_times(period, periods)
    push = np.zeros(time.size)
    for index, frequency in enumerate(FREQUENCIES_HZ):
        push += 0.02 * frequency * np.cos(2.0 * np.pi * frequency * time - 0.7 * index)
    # Nothing is pushed before the first command has arrived; until then all is at rest.
    with scripted(time + period, push[:, None] * along_x(1.0)) as hand:
        session = Session(block(period).model_copy(update={"hand": hand}))
    sample = session.tick()
    start, places, wrench = sample.point.pose.translation[0], [], 0.0
    if not any(wall):
        places = session.run(periods + 1)["device_true_position"][:, 0]
    while len(places) < periods + 1:
        sample = session.tick(along_x(wrench))
        places.append(sample.device.pose.translation[0])
        # The point of this sample, and its velocity: the wall pushes on it from the next one on.
        away, speed = sample.point.pose.translation[0] - start, sample.point.twist[0]
        wrench = -wall[0] * away - wall[1] * speed
    return lines(means_of(push), period) / lines(np.diff(places) / period, period)


@pytest.mark.parametrize(("wall", "order"), [((0.0, 0.0), OWN_ORDER), (WALL, ORDER)])
def test_the_felt_impedance_converges_to_the_mass_and_what_pushes_on_it(wall, order):
    s = 2j * np.pi * FREQUENCIES_HZ
    desired = MASS * s + wall[1] + wall[0] / s
    errors = np.array([np.abs(felt(period, wall) / desired - 1.0) for period in PERIODS])
    orders = np.log2(errors[:-1] / errors[1:])
    assert orders[:, :4] == pytest.approx(order, abs=TOLERANCE)
    assert orders[-1, 4] == pytest.approx(order, abs=TOLERANCE)
    longer = PERIODS[-1] / 2.5e-4
    assert errors[-1, 4] < (1e-4 if order == OWN_ORDER else 0.011) * longer**order


def test_drift_decays_as_the_loops_own_oscillation():
    drift, until = 0.005, 0.4
    # ë + 2 b/m ė + 2 k/m e = 0
    rate, square = DAMPING / MASS, 2.0 * STIFFNESS / MASS
    turn = np.sqrt(square - rate**2)
    errors = []
    for period in PERIODS:
        session, found = Session(block(period)), []
        start, away = session.device.pose, np.array([drift, 0.0, 0.0])
        take_hold_beside(session, pin.SE3(start.rotation, start.translation + away))
        for _ in range(round(until / period)):
            sample = session.tick()
            apart = sample.device.pose.translation - sample.point.pose.translation
            found.append(apart[0])
        time = period * np.arange(len(found))
        wave = np.cos(turn * time) + rate / turn * np.sin(turn * time)
        exact = drift * np.exp(-rate * time) * wave
        errors.append(np.abs(np.array(found) - exact).max() / drift)
    assert np.log2(np.divide(errors[:-1], errors[1:])) == pytest.approx(ORDER, abs=TOLERANCE)
    assert errors[-1] < 0.005
