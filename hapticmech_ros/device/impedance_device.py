"""Simulated impedance-type device: a rigid body between hand and actuators, sampled and held.

    Λ_d ẍ = F_h + F_o + u - b ẋ

u is the command, limited by the actuators and held over a sample period (zero-order hold); so is
F_o, by others than the hand. The hand's own law F_h acts all through the period.
"""

from __future__ import annotations

from typing import ClassVar

import numpy as np
import pinocchio as pin

from hapticmech_ros.device.hand import HandLaw, no_hand
from hapticmech_ros.device.state import DeviceState
from hapticmech_ros.mechanism.model import Array
from hapticmech_ros.saturation import limited
from hapticmech_ros.scene.rendering import Device

NO_WRENCH = np.zeros(6)
NO_WRENCH.flags.writeable = False


class ImpedanceDevice:
    """Steps a device of the scene by one sample period at a time.

    Args:
        device: of the scene.
        period: s.
        planar: whether it moves in x, y and about z only.
        law: of the hand.

    Attributes:
        compiled: whether a kernel computes; see :func:`~hapticmech_ros.device.build.device_for`.
    """

    compiled: ClassVar[bool] = False

    def __init__(self, device: Device, period: float, planar: bool, law: HandLaw = no_hand) -> None:
        self.device = device
        self.period = period
        self._law = law
        self._step = period / device.substeps
        self._damping = np.array([device.damping] * 3 + [device.angular_damping] * 3)
        task = np.array([1.0, 1.0, 0.0, 0.0, 0.0, 1.0]) if planar else np.ones(6)
        # Change of the twist per wrench and step, in the directions that the scene has.
        self._gain = self._step * task / np.array([device.mass] * 3 + [device.inertia] * 3)
        self._ideal = device.position_resolution == 0.0 and device.angle_resolution == 0.0
        cut_off = 2.0 * np.pi * device.velocity_filter * period
        self._filter_gain = cut_off / (1.0 + cut_off)

    def at_rest(self, pose: pin.SE3, held: bool = False) -> DeviceState:
        """Return the device standing still at ``pose``, where the hand takes hold now or not."""
        own = self._law(0.0, pose, NO_WRENCH, pose) if held else NO_WRENCH
        measured = self._quantised(pose)
        return DeviceState(pose, np.zeros(6), measured, np.zeros(6), own, np.zeros(6))

    def step(
        self,
        state: DeviceState,
        command: Array,
        held: DeviceState | None,
        ticks: int,
        push: Array = NO_WRENCH,
    ) -> DeviceState:
        """Advance one period.

        Args:
            state: where to start.
            command: (6,) servo_cf, on the hand by the device, held over the period.
            held: state in which the hand took hold; None if nobody holds.
            ticks: whole periods since then, until ``state``.
            push: (6,) by others than the hand, on the device, world axes.
        """
        actuators = limited(command, self.device.force_limit, self.device.torque_limit)
        step, gain = self._step, self._gain
        pose, twist = state.pose, state.twist
        for index in range(self.device.substeps):
            own = self._hand_wrench(ticks * self.period + index * step, pose, twist, held)
            force = push + own + actuators - self._damping * twist
            twist = twist + gain * force
            pose = pin.SE3(
                pin.exp3(step * twist[3:]) @ pose.rotation, pose.translation + step * twist[:3]
            )
        own = self._hand_wrench((ticks + 1) * self.period, pose, twist, held)
        if self._ideal:
            return DeviceState(pose, twist, pose, twist, own, actuators)
        measured = self._quantised(pose)
        estimated = self._estimated(state, measured)
        return DeviceState(pose, twist, measured, estimated, own, actuators)

    def _hand_wrench(
        self, elapsed: float, pose: pin.SE3, twist: Array, held: DeviceState | None
    ) -> Array:
        return NO_WRENCH if held is None else self._law(elapsed, pose, twist, held.pose)

    def _quantised(self, pose: pin.SE3) -> pin.SE3:
        if self._ideal:
            return pose
        translation, rotation = pose.translation, pose.rotation
        if self.device.position_resolution > 0.0:
            step = self.device.position_resolution
            translation = step * np.round(translation / step)
        if self.device.angle_resolution > 0.0:
            step = self.device.angle_resolution
            rotation = pin.exp3(step * np.round(pin.log3(rotation) / step))
        return pin.SE3(rotation, translation)

    def _estimated(self, before: DeviceState, now: pin.SE3) -> Array:
        """Return the twist from encoder differences, low-passed."""
        old = before.measured_pose
        difference = np.concatenate(
            (now.translation - old.translation, pin.log3(now.rotation @ old.rotation.T))
        )
        change = difference / self.period - before.measured_twist
        return np.asarray(before.measured_twist + self._filter_gain * change)
