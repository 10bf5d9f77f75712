# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Devices held by a scene's hand, of each kind, and runs of them."""

import numpy as np
import pinocchio as pin

from hapticmech_ros.device import GraspSchedule, ImpedanceDevice, grasp_schedule_of
from oracles.device.hand import hand_law, no_hand
from oracles.device.impedance_device import ReadableDevice

PERIOD = 1e-3
START = pin.SE3(pin.exp3(np.array([0.3, -0.2, 0.5])), np.array([0.1, 0.2, 0.3]))
NOTHING = np.zeros(6)
# In plain NumPy; by one kernel; and by kernels around a hand's law in Python.
KINDS = ("readable", "kernel", "own hand")


def body_of(kind, device, hand=None, planar=False, period=PERIOD):
    """Return a device of a scene, held by a scene's hand."""
    if kind == "kernel":
        return ImpedanceDevice(device, period, planar, hand)
    law, schedule = (
        (no_hand, GraspSchedule()) if hand is None else (hand_law(hand), grasp_schedule_of(hand))
    )
    if kind == "own hand":
        return ImpedanceDevice(device, period, planar, law=law, schedule=schedule)
    return ReadableDevice(device, period, planar, law, schedule)


def readable_device_for(scene, with_hand=True):
    """Return the readable device of a scene."""
    hand = scene.hand if with_hand else None
    period, planar = scene.simulation.period, scene.task_space == "planar"
    return body_of("readable", scene.device, hand, planar, period)


def run(body, ticks, command=NOTHING, push=NOTHING, start=None):
    """Return the states at 0, 1, ... ``ticks`` periods; ``push`` may be a function of time (s)."""
    state = body.at_rest(START, held=True) if start is None else start
    states, held = [state], state
    for tick in range(ticks):
        pushed = push(tick * body.period) if callable(push) else push
        states.append(body.step(states[-1], command, held, tick, np.asarray(pushed, dtype=float)))
    return states


def moving(body, twist):
    """Return a state next to ``START`` that moves with nearly this twist, after one hard push.

    Friction and damping have taken a little of it; its direction is kept.
    """
    device = body.device
    mass = np.repeat((device.mass, device.inertia), 3)
    return body.step(body.at_rest(START), NOTHING, None, 0, mass * twist / body.period)
