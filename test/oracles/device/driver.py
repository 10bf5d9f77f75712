# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What a device's driver does at the sample rate: compensation before, force sensing after."""

from __future__ import annotations

import math

import numpy as np

from hapticmech_ros.arrays import Array
from hapticmech_ros.device import NO_WRENCH, DeviceState
from hapticmech_ros.saturation import limited
from hapticmech_ros.scene.device import Device
from oracles.device.force_observer import ForceObserver


class DeviceDriver:
    """Between commands and actuators, and between encoders and what is reported.

    Args:
        device: of the scene.
        period: s.
        task: (6,) 1 in directions that the scene has, 0 in others.

    Attributes:
        weight: (6,) gravity's wrench on the device, N and N m; None if it is balanced.
        senses_itself: whether the reported wrench is not the sensor's.
    """

    def __init__(self, device: Device, period: float, task: Array) -> None:
        self._device, self._period, self._task = device, period, task
        weight = task * np.array((*device.gravity_load, 0.0, 0.0, 0.0))
        self.weight = weight if weight.any() else None
        self.senses_itself = device.force_sensor != "measured"
        compensation = device.compensation
        self._adds = compensation.friction > 0.0 or (compensation.gravity and weight.any())
        self._turns = device.actuated == "all"
        self._lag = 2.0 * math.pi * device.actuator_bandwidth * period
        self._observer = ForceObserver(
            inertia=np.array([device.mass] * 3 + [device.inertia] * 3),
            damping=np.array([device.damping] * 3 + [device.angular_damping] * 3),
            weight=weight,
            task=task,
            bandwidth=device.observer_bandwidth,
            period=period,
        )

    def asked(self, state: DeviceState, command: Array | None) -> Array:
        """Return what actuators are asked for over a period, (6,), before saturation.

        Args:
            state: at the period's start; what is measured of it counts.
            command: (6,) servo_cf; None for actuators off, and compensation with them.
        """
        if command is None:
            return NO_WRENCH
        if self._adds:
            command = command + self.added(state)
        if not self._turns:
            command = np.concatenate((command[:3], NO_WRENCH[3:]))
        return command

    def reported(self, before: DeviceState, twist: Array, asked: Array) -> Array:
        """Return what is reported of the hand's wrench without a sensor, (6,).

        Args:
            before: state at the period's start.
            twist: (6,) measured at its end.
            asked: (6,) of the actuators, as :meth:`asked`.
        """
        if self._device.force_sensor == "absent":
            return NO_WRENCH
        actuators = limited(asked, self._device.force_limit, self._device.torque_limit)
        if self._lag > 0.0:
            # Mean over the period of a first-order lag's way from what it was to what is asked.
            share = -math.expm1(-self._lag) / self._lag
            actuators = actuators + share * (before.applied - actuators)
        known = self._friction(0.5 * (before.measured_twist + twist), viscous=False)
        measured = before.measured_twist
        return self._observer.next(before.reported, measured, twist, actuators, known)

    def added(self, state: DeviceState) -> Array:
        """Return the compensating wrench (6,) for a period that begins at a state."""
        if not self._adds:
            return NO_WRENCH
        given = self._friction(state.measured_twist, viscous=True)
        if self._device.compensation.gravity and self.weight is not None:
            return np.asarray(self._task * (given - self.weight))
        return np.asarray(self._task * given)

    def _friction(self, twist: Array, viscous: bool) -> Array:
        """Return the share of friction that the driver knows and gives back, along the twist."""
        device, known = self._device, self._device.compensation
        if known.friction == 0.0:
            return NO_WRENCH
        damping = (device.damping, device.angular_damping) if viscous else (0.0, 0.0)
        parts = (
            _along(twist[:3], known.dead_zone, device.coulomb_friction, damping[0]),
            _along(twist[3:], known.angular_dead_zone, device.angular_coulomb_friction, damping[1]),
        )
        return np.asarray(known.friction * np.concatenate(parts))


def _along(rate: Array, dead_zone: float, coulomb: float, damping: float) -> Array:
    """Return friction's force or torque (3,) at a rate (3,), none of it in the dead zone."""
    speed = math.sqrt(rate @ rate)
    share = min(max(speed / dead_zone - 1.0, 0.0), 1.0)
    return np.zeros(3) if share == 0.0 else share * (coulomb / speed + damping) * rate
