# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What a session asks of a device: of the simulated one, and of one of one's own in Python."""

from __future__ import annotations

from typing import Protocol

import pinocchio as pin

from hapticmech_ros.arrays import Array
from hapticmech_ros.device.state import NO_WRENCH, DeviceState


class SimulatedDevice(Protocol):
    """A device that a session can hold and move: ``Session(scene, device=...)``.

    Of the states that it returns a session reads what is published of them, and ``pose`` of the
    first one; it hands each back to the next step as it is. One that needs more than a
    :class:`~hapticmech_ros.device.state.DeviceState` has room for is a subclass of that.
    """

    def at_rest(
        self, pose: pin.SE3, held: bool = False, home: pin.SE3 | None = None
    ) -> DeviceState:
        """Return the device standing still.

        Args:
            pose: where, in the world.
            held: whether the hand can take hold now.
            home: pose about which the workspace is; ``pose`` if left out.
        """
        ...

    def step(
        self,
        state: DeviceState,
        command: Array | None,
        held: DeviceState | None,
        ticks: int,
        push: Array = NO_WRENCH,
    ) -> DeviceState:
        """Return the state one period later; ``state`` is left as it is.

        Args:
            state: where to start.
            command: (6,) servo_cf, N and N m, on the hand by the device, world axes, held over the
                period; None for actuators off, compensation included.
            held: state in which the hand could take hold; None if nobody is there.
            ticks: whole periods since then, until ``state``.
            push: (6,) by others than the hand, on the device, N and N m, world axes.
        """
        ...

    def compensation(self, state: DeviceState) -> Array:
        """Return the wrench (6,) that the driver adds over the next period, N, N m, world axes."""
        ...

    def sensed(self, push: Array) -> Array:
        """Return what a force sensor, if any, reads of others' ``push`` (6,) besides the hand's.

        Args:
            push: (6,) by others on the device, N and N m, world axes at the point held.
        """
        ...
