# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What is written of a device's state is what it measures, with pushes added."""

import numpy as np
import pinocchio as pin

from hapticmech_ros import load_scene
from hapticmech_ros.control import DeviceMeasurement
from hapticmech_ros.control.measurements import flat_device
from hapticmech_ros.device import NO_WRENCH, device_for
from hapticmech_ros.wire.layouts import write_device_state
from hapticmech_ros.wire.messages import DeviceStateMessage

STAMP = 1_700_000_000_123_456_789


def test_what_is_written_is_what_is_packed_with_pushes_added():
    rng = np.random.default_rng(0)
    written = DeviceStateMessage()
    body = device_for(load_scene("spatial_arm"))
    pose = pin.SE3(pin.exp3(np.array([0.3, -2.0, 0.5])), np.array([0.1, 0.2, 0.3]))
    state = start = body.at_rest(pose, held=True)
    for ticks in range(600, 605):
        state = body.step(state, rng.normal(size=6), start, ticks)
        before, stamp = state.hand_wrench.copy(), STAMP + ticks
        push = rng.normal(size=6) if ticks % 2 else NO_WRENCH
        told = 0.01 * ticks, bool(ticks % 2)
        write_device_state(written, state, push, stamp, *told)
        hand = push + state.hand_wrench
        measured = DeviceMeasurement(state.measured_pose, state.measured_twist, hand)
        expected = DeviceStateMessage.of(stamp, sample=flat_device(measured), applied=state.applied)
        expected.round_trip, expected.obeys = told
        assert np.array_equal(written.values, expected.values)
        # The state keeps the hand's own wrench.
        assert np.array_equal(state.hand_wrench, before)
