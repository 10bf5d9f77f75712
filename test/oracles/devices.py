# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Devices held by a scene's hand, runs of them, and the law of a scene's hand as it is written."""

import numpy as np
import pinocchio as pin

from hapticmech_ros.device import ImpedanceDevice, grasp_schedule_of
from hapticmech_ros.device.hand import hand_numbers
from hapticmech_ros.device.hand_kernels import Body, HandModel, Place, hand_wrench

PERIOD = 1e-3
START = pin.SE3(pin.exp3(np.array([0.3, -0.2, 0.5])), np.array([0.1, 0.2, 0.3]))
NOTHING = np.zeros(6)


def body_of(device, hand=None, planar=False):
    """Return a device of a scene, held by a scene's hand."""
    return ImpedanceDevice(device, PERIOD, planar, hand)


def law_of(hand):
    """Return what a scene's hand does as a law in Python: the kernels' own, not compiled."""
    numbers = hand_numbers(hand, grasp_schedule_of(hand))
    model, plan = HandModel(numbers), numbers[HandModel.layout.size :]

    def law(elapsed, pose, twist, held):
        wrench = np.empty(6)
        body, place = (np.append(one.translation, one.rotation.ravel()) for one in (pose, held))
        hand_wrench(model, plan, elapsed, Body(np.append(body, twist)), Place(place), wrench)
        return wrench

    return law


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
