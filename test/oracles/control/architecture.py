# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Fig. 3: the three controllers joined, from measurements to the wrenches of both sides."""

from __future__ import annotations

from copy import copy

import numpy as np

from hapticmech_ros.arrays import Array
from hapticmech_ros.control import (
    Clutch,
    ControlArchitecture,
    ControlOutput,
    DeviceMeasurement,
    OperationalModel,
    PointMeasurement,
)
from hapticmech_ros.control.clutch import pose_error
from hapticmech_ros.control.measurements import (
    InFlight,
    device_of,
    flat_operational_model,
    model_of,
    point_ahead,
)
from hapticmech_ros.saturation import limited
from oracles.control.four_channel import channel_wrenches
from oracles.control.impedance import impedance_wrench
from oracles.control.joint_constraint import joint_constraint_wrench


class ReadableControl(ControlArchitecture):
    """The controllers of a scene; arguments and results as of the class that it is an oracle of."""

    def answer(
        self,
        time: float,
        clutch: Clutch,
        device: Array,
        operational_model: Array,
        ahead: float,
        in_flight: InFlight | None = None,
    ) -> Array:
        """Return the wrenches for measurements, (6, 6): rows as in :class:`ControlOutput`."""
        point = point_ahead(operational_model, ahead, in_flight)
        found = self.compute(time, clutch, device_of(device), point, model_of(operational_model))
        return found.rows()

    def compute(
        self,
        time: float,
        clutch: Clutch,
        device: DeviceMeasurement,
        point: PointMeasurement,
        model: OperationalModel,
        in_flight: InFlight | None = None,
    ) -> ControlOutput:
        """Return the wrenches for measurements at ``time`` (s)."""
        self.apply_gains_at(time)
        if in_flight is not None:
            point = point_ahead(flat_operational_model(model, point), 0.0, in_flight)
        gains, task = self.gains, self.task
        error = task * pose_error(point.pose, clutch.mapped(device.pose))
        error_rate = task * (device.twist - point.twist)
        hand = task * device.hand_wrench
        contact = task * point.contact_wrench
        force = gains.force_channel
        share, push = model.wrench_projector, hand + force.contact * contact
        joint = gains.joint_constraint
        ramp, through = clutch.ramp(time), clutch.force_ramp(time)
        balanced = impedance_wrench(
            self.device_inertia,
            model.inverse_inertia,
            share,
            model.free_acceleration,
            push,
            1.0,
            np.zeros(6),
            force.device_feedback * hand,
        )
        rest = (1.0 - joint.feedforward) * (share @ push)
        impedance = task * (through * balanced + ramp * rest)
        mass = np.diag(self.device_inertia)
        share_of_damper = clutch.brake(time, joint.damping / mass[0])
        constraint = joint_constraint_wrench(
            joint, model.constraint_projector, ramp * error, share_of_damper * error_rate
        )
        linear, angular = np.linalg.norm(constraint[:3]), np.linalg.norm(constraint[3:])
        excess = max(linear / joint.force_limit, angular / joint.torque_limit)
        constraint /= max(excess / through, 1.0) if through > 0.0 else 1.0
        none = np.zeros(6)
        slowed = copy(self.channels)
        slowed.damping = self._slowed(time, clutch, slowed.damping)
        slowed.held_damping = self._slowed(time, clutch, slowed.held_damping)
        springs = channel_wrenches(slowed, share, ramp * error, none, none, none)
        dampers = channel_wrenches(slowed, share, none, error_rate, none, none)
        forces = channel_wrenches(self.channels, share, none, none, hand, contact)
        channel = through * forces.device + springs.device + dampers.device
        told = through * forces.mechanism + springs.mechanism + dampers.mechanism
        total = impedance + constraint + channel
        return ControlOutput(
            device=self.joined(time, clutch, limited(total, *self.limits)),
            mechanism=limited(told, *self.limits),
            impedance=impedance,
            joint_constraint=constraint,
            four_channel=channel,
            error=error,
        )

    def _slowed(self, time: float, clutch: Clutch, damping: Array) -> Array:
        """Return what a clutch lets through of a diagonal damping (6,)."""
        mass = np.diag(self.device_inertia)
        return np.array([b * clutch.brake(time, b / m) for b, m in zip(damping, mass, strict=True)])
