"""Simulated impedance-type device: a rigid body between hand and actuators, sampled and held.

    Λ_d ẍ = F_h + u - b ẋ

u is the command, limited by the actuators and held over a sample period (zero-order hold).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from hapticmech_ros.device.hand import HandLaw
from hapticmech_ros.mechanism.model import Array
from hapticmech_ros.saturation import limited
from hapticmech_ros.scene.document import Device


@dataclass(frozen=True, slots=True)
class DeviceState:
    """True state of the device, and what its encoders said last.

    Attributes:
        pose: of the point held, in the world.
        twist: (6,) of the point held, world axes.
        measured_pose: pose rounded to encoder steps.
        measured_twist: twist as estimated from the encoders; the true one if they are ideal.
    """

    pose: pin.SE3
    twist: Array
    measured_pose: pin.SE3
    measured_twist: Array


class ImpedanceDevice:
    """Steps a device of the scene by one sample period at a time."""

    def __init__(self, device: Device, period: float, planar: bool) -> None:
        self.device = device
        self.period = period
        self._step = period / device.substeps
        self._damping = np.array([device.damping] * 3 + [device.angular_damping] * 3)
        task = np.array([1.0, 1.0, 0.0, 0.0, 0.0, 1.0]) if planar else np.ones(6)
        # Change of the twist per wrench and step, in the directions that the scene has.
        self._gain = self._step * task / np.array([device.mass] * 3 + [device.inertia] * 3)
        self._ideal = device.position_resolution == 0.0 and device.angle_resolution == 0.0
        cut_off = 2.0 * np.pi * device.velocity_filter * period
        self._filter_gain = cut_off / (1.0 + cut_off)

    def at_rest(self, pose: pin.SE3) -> DeviceState:
        """Return the device standing still at ``pose``."""
        return DeviceState(pose, np.zeros(6), self._quantised(pose), np.zeros(6))

    def limited(self, command: Array) -> Array:
        """Return what the actuators give of a command (6,)."""
        return limited(command, self.device.force_limit, self.device.torque_limit)

    def step(
        self, state: DeviceState, command: Array, hand: HandLaw, elapsed: float, held: pin.SE3
    ) -> DeviceState:
        """Advance one period.

        Args:
            state: where to start.
            command: (6,) servo_cf, on the hand by the device, held over the period.
            hand: the hand's law, which acts all through the period.
            elapsed: s since engagement, for the hand.
            held: pose when the hand took hold.
        """
        actuators = self.limited(command)
        step, gain = self._step, self._gain
        pose, twist = state.pose, state.twist
        for index in range(self.device.substeps):
            push = hand(elapsed + index * step, pose, twist, held)
            force = push + actuators - self._damping * twist
            twist = twist + gain * force
            pose = pin.SE3(
                pin.exp3(step * twist[3:]) @ pose.rotation, pose.translation + step * twist[:3]
            )
        if self._ideal:
            return DeviceState(pose, twist, pose, twist)
        measured = self._quantised(pose)
        return DeviceState(pose, twist, measured, self._estimated(state, measured))

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
