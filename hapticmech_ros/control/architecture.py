"""Fig. 3: the three controllers joined, from measurements to the wrenches of both sides."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from hapticmech_ros.control.engagement import Engagement, engage, pose_error
from hapticmech_ros.control.four_channel import FourChannel
from hapticmech_ros.control.impedance import impedance_wrench
from hapticmech_ros.control.joint_constraint import joint_constraint_wrench
from hapticmech_ros.mechanism.model import Array
from hapticmech_ros.saturation import limited
from hapticmech_ros.scene.document import Device, Scene


@dataclass(frozen=True, slots=True)
class DeviceMeasurement:
    """What the device reports, world axes: pose, twist (6,), hand wrench F_h (6,) on the device."""

    pose: pin.SE3
    twist: Array
    hand_wrench: Array


@dataclass(frozen=True, slots=True)
class PointMeasurement:
    """What the mechanism reports of its operational point, world axes.

    ``contact_wrench`` (6,) F_c is by the environment on the mechanism, at the point.
    """

    pose: pin.SE3
    twist: Array
    contact_wrench: Array


@dataclass(frozen=True, slots=True)
class RenderingModel:
    """What the analysis reports: X, P_c, Π (6, 6 each) and a_0 (6,), world axes at the point."""

    inverse_inertia: Array
    constraint_projector: Array
    balanced_share: Array
    free_acceleration: Array


@dataclass(frozen=True, slots=True)
class ControlOutput:
    """Wrenches of one control period, world axes, N and N m.

    Attributes:
        device: (6,) servo_cf of the device: on the hand, by the device.
        mechanism: (6,) servo_cf of the operational point: on the mechanism, by the hand.
        impedance, joint_constraint, four_channel: (6,) the three parts of ``device``.
        error: (6,) pose error e, m and rad.
    """

    device: Array
    mechanism: Array
    impedance: Array
    joint_constraint: Array
    four_channel: Array
    error: Array


class ControlArchitecture:
    """The controllers of a scene. Holds gains only; state is the :class:`Engagement`."""

    def __init__(self, scene: Scene) -> None:
        self.gains = scene.controller
        self.limits = (scene.device.force_limit, scene.device.torque_limit)
        self.device_inertia = device_inertia(scene.device)
        self._channels = FourChannel(self.gains.position_channel, self.gains.force_channel)
        self._task = np.ones(6)
        if scene.task_space == "planar":
            self._task[2:5] = 0.0

    def engage(self, time: float, device: pin.SE3, point: pin.SE3) -> Engagement:
        """Start rendering: tie the device's present pose to the point's."""
        return engage(time, device, point)

    def compute(
        self,
        time: float,
        engagement: Engagement,
        device: DeviceMeasurement,
        point: PointMeasurement,
        model: RenderingModel,
    ) -> ControlOutput:
        """Return the wrenches for the measurements at ``time`` (s)."""
        gains = self.gains
        task = self._task
        error = task * pose_error(point.pose, engagement.mapped(device.pose))
        error_rate = task * (device.twist - point.twist)
        hand = task * device.hand_wrench
        contact = task * point.contact_wrench
        impedance = task * impedance_wrench(
            self.device_inertia,
            model.inverse_inertia,
            model.balanced_share,
            model.free_acceleration,
            hand + contact,
            gains.joint_constraint.feedforward,
            np.zeros(6),
        )
        constraint = joint_constraint_wrench(
            gains.joint_constraint, model.constraint_projector, error, error_rate
        )
        channels = self._channels.wrenches(model.balanced_share, error, error_rate, hand, contact)
        ramp = engagement.ramp(time, gains.engagement_ramp)
        total = ramp * (impedance + constraint + channels.device)
        return ControlOutput(
            device=limited(total, *self.limits),
            mechanism=limited(ramp * channels.mechanism, *self.limits),
            impedance=ramp * impedance,
            joint_constraint=ramp * constraint,
            four_channel=ramp * channels.device,
            error=error,
        )


def device_inertia(device: Device) -> Array:
    """Return Λ_d (6, 6) of a device with isotropic mass and inertia at the point held."""
    return np.diag([device.mass] * 3 + [device.inertia] * 3)
