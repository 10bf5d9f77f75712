"""The device that runs: :class:`ImpedanceDevice` with a period in one kernel."""

from __future__ import annotations

from typing import ClassVar

import numpy as np
import pinocchio as pin

from hapticmech_ros.device import kernels
from hapticmech_ros.device.compiled_state import CompiledState
from hapticmech_ros.device.hand import hand_law, no_hand, spring_gains, target_table
from hapticmech_ros.device.hand_kernels import CONSTANT, NOBODY, SPRING, WAYPOINTS
from hapticmech_ros.device.impedance_device import NO_WRENCH, ImpedanceDevice
from hapticmech_ros.device.state import DeviceState
from hapticmech_ros.mechanism.model import Array
from hapticmech_ros.scene.rendering import ConstantWrenchHand, Device, Hand


class CompiledDevice(ImpedanceDevice):
    """A device of the scene; results equal the parent's to rounding, at a tenth of the time.

    Besides constants it holds scratch: one for each thread.

    Args:
        device: of the scene.
        period: s.
        planar: whether it moves in x, y and about z only.
        hand: of the scene; None if there is none.
    """

    compiled: ClassVar[bool] = True

    def __init__(self, device: Device, period: float, planar: bool, hand: Hand | None) -> None:
        super().__init__(device, period, planar, no_hand if hand is None else hand_law(hand))
        scalars = (
            *(self._step, period, device.substeps, self._filter_gain),
            *(device.force_limit, device.torque_limit),
            *(device.position_resolution, device.angle_resolution),
        )
        acting = np.zeros(kernels.HAND - kernels.COMMAND)
        self._data = np.concatenate((scalars, self._damping, self._gain, acting, _flat(hand)))
        self._command = self._data[kernels.COMMAND : kernels.PUSH]
        self._push = self._data[kernels.PUSH : kernels.HELD]
        self._held: DeviceState | None = None

    def at_rest(self, pose: pin.SE3, held: bool = False) -> CompiledState:
        """Return the device standing still; see :meth:`ImpedanceDevice.at_rest`."""
        return CompiledState.of(super().at_rest(pose, held))

    def step(
        self,
        state: DeviceState,
        command: Array,
        held: DeviceState | None,
        ticks: int,
        push: Array = NO_WRENCH,
    ) -> CompiledState:
        """Advance one period; see :meth:`ImpedanceDevice.step`."""
        if not isinstance(state, CompiledState):
            state = CompiledState.of(state)
        if held is None:
            ticks = -1
        elif held is not self._held:
            self._take_hold(held)
        self._command[:] = command
        self._push[:] = push
        flat = np.empty(kernels.STATE_SIZE)
        kernels.advance(self._data, state.flat, ticks, flat)
        return CompiledState(flat)

    def _take_hold(self, held: DeviceState) -> None:
        pose = held.pose
        place = np.concatenate((pose.translation, pose.rotation.ravel()))
        self._data[kernels.HELD : kernels.HAND] = place
        self._held = held


def _flat(hand: Hand | None) -> Array:
    """Return a hand as :mod:`~hapticmech_ros.device.hand_kernels` reads it."""
    if hand is None:
        return np.full(WAYPOINTS, NOBODY)
    if isinstance(hand, ConstantWrenchHand):
        wrench = (*hand.force, *hand.torque)
        return np.array((CONSTANT, hand.start_delay, *wrench, *NO_WRENCH))
    times, offsets = target_table(hand)
    table = np.column_stack((times, offsets))
    head = (SPRING, hand.start_delay)
    return np.concatenate((head, *spring_gains(hand), table.ravel()))
