# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Writing ``device/state`` messages in place, at the control rate."""

from __future__ import annotations

import numpy as np

from hapticmech_ros.arrays import Array
from hapticmech_ros.device import NO_WRENCH, DeviceState
from hapticmech_ros.wire.layouts import DEVICE_FIELDS, OBEYS, ROUND_TRIP
from hapticmech_ros.wire.stamps import seconds_of


class DeviceWriter:
    """A ``device/state`` message's data, written anew for each state of the device.

    What :func:`~hapticmech_ros.wire.layouts.pack_device` returns, without the objects between.

    Attributes:
        values: (29,) the data.
        hand_wrench: (6,) F_h of the state seen last, with what others added, N and N m, world
            axes; a view.
    """

    def __init__(self) -> None:
        self.values: Array = np.zeros(DEVICE_FIELDS.size)
        self.hand_wrench: Array = self.values[DEVICE_FIELDS.slice("hand_wrench")]
        self._published = self.values[DEVICE_FIELDS.slice("position", "applied")]

    def encode(
        self,
        state: DeviceState,
        push: Array,
        stamp_ns: int,
        round_trip: float = 0.0,
        obeys: bool = True,
    ) -> None:
        """Write a state.

        Args:
            state: of the device.
            push: (6,) by others, added to the hand's wrench; N and N m, world axes.
            stamp_ns: ns.
            round_trip: s, from a sample to its answer; 0: not known.
            obeys: whether the device obeys servo_cf.
        """
        self.values[0], self.values[1] = seconds_of(stamp_ns)
        self._published[:] = state.published
        self.values[ROUND_TRIP], self.values[OBEYS] = round_trip, obeys
        if push is not NO_WRENCH:
            self.hand_wrench += push
