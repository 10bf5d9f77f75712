"""Writing ``device/state`` messages in place, at the control rate."""

from __future__ import annotations

import numpy as np

from hapticmech_ros.device import NO_WRENCH, DeviceState
from hapticmech_ros.mechanism.model import Array
from hapticmech_ros.times import NANOSECONDS
from hapticmech_ros.wire.layouts import DEVICE_FIELDS, DEVICE_MEASURED


class DeviceWriter:
    """A ``device/state`` message's data, written anew for each state of the device.

    What :func:`~hapticmech_ros.wire.layouts.pack_device` returns, without the objects between.

    Attributes:
        values: (28,) the data.
        hand_wrench: (6,) F_h of the state seen last, with what others added; a view.
    """

    def __init__(self) -> None:
        self.values: Array = np.zeros(sum(DEVICE_FIELDS.values()))
        last = DEVICE_MEASURED.stop
        self.hand_wrench: Array = self.values[last - DEVICE_FIELDS["hand_wrench"] : last]
        self._published = self.values[DEVICE_FIELDS["stamp"] : -DEVICE_FIELDS["round_trip"]]

    def see(self, state: DeviceState, push: Array, stamp_ns: int, round_trip: float = 0.0) -> None:
        """Write a state.

        Args:
            state: of the device.
            push: (6,) by others, added to the hand's wrench.
            stamp_ns: ns.
            round_trip: s, from a sample to its answer; 0: not known.
        """
        self.values[0], self.values[1] = divmod(stamp_ns, NANOSECONDS)
        self._published[:] = state.published
        self.values[-1] = round_trip
        if push is not NO_WRENCH:
            self.hand_wrench += push
