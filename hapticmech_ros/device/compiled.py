"""The device that runs: :class:`ImpedanceDevice` with a period in one kernel."""

from __future__ import annotations

from typing import ClassVar

import numpy as np
import pinocchio as pin

from hapticmech_ros.arrays import Array
from hapticmech_ros.device import hand_kernels as laws
from hapticmech_ros.device import kernels
from hapticmech_ros.device.compiled_state import CompiledState
from hapticmech_ros.device.device_layout import DEVICE_MODEL, DEVICE_STATE
from hapticmech_ros.device.driver import NO_WRENCH
from hapticmech_ros.device.grip import ALWAYS, Grip, grip_of
from hapticmech_ros.device.hand import hand_law, no_hand, spring_gains, target_table
from hapticmech_ros.device.impedance_device import ImpedanceDevice
from hapticmech_ros.device.state import DeviceState
from hapticmech_ros.scene.device import Device
from hapticmech_ros.scene.hand import ConstantWrenchHand, Hand, ScriptedHand
from hapticmech_ros.scene.script import read_script

_PUSH, _HELD = DEVICE_MODEL.slice("push"), DEVICE_MODEL.slice("held")


class CompiledDevice(ImpedanceDevice):
    """A device of the scene; results equal the parent's to rounding, at a tenth of the time.

    Besides constants it holds what acts: one for each thread.

    Args:
        device: of the scene.
        period: s.
        planar: whether it moves in x, y and about z only.
        hand: of the scene; None if there is none.

    Attributes:
        data: a :data:`~hapticmech_ros.device.device_layout.DEVICE_MODEL`, and the hand.
        held: the device when the hand could take hold; None before.
    """

    compiled: ClassVar[bool] = True

    def __init__(self, device: Device, period: float, planar: bool, hand: Hand | None) -> None:
        law, grip = (no_hand, ALWAYS) if hand is None else (hand_law(hand), grip_of(hand))
        super().__init__(device, period, planar, law, grip)
        self.data: Array = np.concatenate((np.zeros(DEVICE_MODEL.size), _flat(hand, grip)))
        for name, value in self._constants().items():
            self.data[DEVICE_MODEL.slice(name)] = value
        self.held: DeviceState | None = None

    def _constants(self) -> dict[str, object]:
        """Return what is constant, by names of :data:`DEVICE_MODEL`."""
        device, driver, resistance = self.device, self._driver, self._resistance
        return {
            "step": self._step,
            "period": self.period,
            "substeps": device.substeps,
            "filter_gain": self._filter_gain,
            "force_limit": device.force_limit,
            "torque_limit": device.torque_limit,
            "position_step": device.position_resolution,
            "angle_step": device.angle_resolution,
            "lag": self._lag[0],
            "lag_mean": self._lag[1],
            "friction": resistance.friction[0],
            "angular_friction": resistance.friction[1],
            "stop": resistance.stops[0].numbers,
            "angular_stop": resistance.stops[1].numbers,
            "damping": self._damping,
            "gain": self._gain,
            "held_gain": self._held_gain,
            "arm": self._arm,
            **driver.constants(),
        }

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
        elif held is not self.held:
            self.take_hold(held)
        self.data[_PUSH] = push
        flat = np.empty(DEVICE_STATE.size)
        obeys, asked = command is not None, NO_WRENCH if command is None else command
        kernels.advance(self.data, state.flat, asked, obeys, ticks, flat)
        return CompiledState(flat)

    def compensation(self, state: DeviceState) -> Array:
        """Return what the driver adds to a command over the next period (6,)."""
        added = np.empty(6)
        kernels.compensation(self.data, state.measured_twist, added)
        return added

    def take_hold(self, held: DeviceState) -> None:
        """Say where the device was when the hand could take hold."""
        pose = held.pose
        self.data[_HELD] = np.concatenate((pose.translation, pose.rotation.ravel()))
        self.held = held


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
