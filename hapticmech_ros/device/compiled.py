"""The device that runs: :class:`ImpedanceDevice` with a period in one kernel."""

from __future__ import annotations

from typing import ClassVar

import numpy as np
import pinocchio as pin

from hapticmech_ros.arrays import Array
from hapticmech_ros.device import hand_kernels as laws
from hapticmech_ros.device import kernels
from hapticmech_ros.device.compiled_state import CompiledState
from hapticmech_ros.device.driver import NO_WRENCH
from hapticmech_ros.device.grip import ALWAYS, Grip, grip_of
from hapticmech_ros.device.hand import hand_law, no_hand, spring_gains, target_table
from hapticmech_ros.device.impedance_device import ImpedanceDevice
from hapticmech_ros.device.state import DeviceState
from hapticmech_ros.scene.device import Device
from hapticmech_ros.scene.hand import ConstantWrenchHand, Hand, ScriptedHand
from hapticmech_ros.scene.script import read_script


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
        law, grip = (no_hand, ALWAYS) if hand is None else (hand_law(hand), grip_of(hand))
        super().__init__(device, period, planar, law, grip)
        scalars = (
            *(self._step, period, device.substeps, self._filter_gain),
            *(device.force_limit, device.torque_limit),
            *(device.position_resolution, device.angle_resolution),
            *self._lag,
            *self._resistance.friction,
            *(value for stop in self._resistance.stops for value in stop.numbers),
        )
        arrays = (self._damping, self._gain, self._held_gain, self._arm)
        acting = np.zeros(kernels.HAND - kernels.COMMAND)
        self._data = np.concatenate((scalars, *arrays, acting, _flat(hand, self._grip)))
        self._command = self._data[kernels.COMMAND : kernels.PUSH]
        self._push = self._data[kernels.PUSH : kernels.HELD]
        self._held: DeviceState | None = None

    def at_rest(
        self, pose: pin.SE3, held: bool = False, home: pin.SE3 | None = None
    ) -> CompiledState:
        """Return the device standing still; see :meth:`ImpedanceDevice.at_rest`."""
        return CompiledState.of(super().at_rest(pose, held, home))

    def step(
        self,
        state: DeviceState,
        command: Array | None,
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
        asked = self._driver.asked(state, command)
        self._command[:] = asked
        self._push[:] = self._weighed(push)
        flat = np.empty(kernels.STATE_SIZE)
        kernels.advance(self._data, state.flat, ticks, flat)
        after = CompiledState(flat)
        if self._driver.senses_itself:
            after.reported[:] = self._driver.reported(state, after.measured_twist, asked)
        return after

    def _take_hold(self, held: DeviceState) -> None:
        pose = held.pose
        place = np.concatenate((pose.translation, pose.rotation.ravel()))
        self._data[kernels.HELD : kernels.HAND] = place
        self._held = held


def _flat(hand: Hand | None, grip: Grip) -> Array:
    """Return a hand as :mod:`~hapticmech_ros.device.hand_kernels` reads it."""
    head = np.zeros(laws.TIMES)
    head[laws.KIND], head[laws.START] = laws.NOBODY, grip.start
    head[laws.HOLDS_FIRST], head[laws.SWITCHES] = grip.holds_first, len(grip.switches)
    rows = np.empty(0)
    if isinstance(hand, ConstantWrenchHand):
        head[laws.KIND] = laws.CONSTANT
        head[laws.STIFFNESS : laws.DAMPING] = (*hand.force, *hand.torque)
    elif isinstance(hand, ScriptedHand):
        head[laws.KIND] = laws.STAIRS if hand.interpolation == "held" else laws.SCRIPT
        rows = read_script(hand.file)
    elif hand is not None:
        head[laws.KIND] = laws.SPRING
        head[laws.STIFFNESS : laws.TREMBLING] = np.concatenate(spring_gains(hand))
        rows = np.column_stack(target_table(hand))
    tremor = None if hand is None else hand.tremor
    if tremor is not None:
        head[laws.SPEED] = 2.0 * np.pi * tremor.frequency
        head[laws.TREMBLING : laws.SWAY] = (*tremor.force, *tremor.torque)
        head[laws.SWAY : laws.SPEED] = (*tremor.xyz, *tremor.rotation)
    return np.concatenate((head, grip.switches, rows.ravel()))
