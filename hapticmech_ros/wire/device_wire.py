"""Writing ``device/state`` messages in place, at the control rate."""

from __future__ import annotations

import numpy as np

from hapticmech_ros.device import NO_WRENCH, DeviceState
from hapticmech_ros.mechanism.model import Array
from hapticmech_ros.wire.layouts import DEVICE_FIELDS, DEVICE_MEASURED
from hapticmech_ros.wire.stamps import seconds_of


class DeviceWriter:
    """A ``device/state`` message's data, written anew for each state of the device.

    What :func:`~hapticmech_ros.wire.layouts.pack_device` returns, without the objects between.

    Attributes:
        values: (27,) the data.
        hand_wrench: (6,) F_h of the state seen last, with what others added; a view.
    """

    def __init__(self) -> None:
        self.values: Array = np.zeros(sum(DEVICE_FIELDS.values()))
        last = DEVICE_MEASURED.stop
        self.hand_wrench: Array = self.values[last - DEVICE_FIELDS["hand_wrench"] : last]
        self._published = self.values[DEVICE_FIELDS["stamp"] :]

    def see(self, state: DeviceState, push: Array, stamp_ns: int) -> None:
        """Write a state at a time (ns); ``push`` (6,) is by others, added to the hand's wrench."""
        self.values[0], self.values[1] = seconds_of(stamp_ns)
        self._published[:] = state.published
        if push is not NO_WRENCH:
            self.hand_wrench += push
