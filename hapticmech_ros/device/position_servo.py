# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The impedance between a device and a pose that it is commanded to."""

from __future__ import annotations

import math

import numpy as np
import pinocchio as pin

from hapticmech_ros.arrays import Array
from hapticmech_ros.device.safety import SafetyLimits
from hapticmech_ros.scene.device import Device, most_servo_stiffness

# N/m and N m/rad: a finger's push of 1 N moves the device by 5 mm.
STIFFNESS, ANGULAR_STIFFNESS = 200.0, 0.1


class PositionServo:
    """Pulls a device to a pose, by a spring and damper in translation and one in rotation.

        F = K e - B ẋ,  e = (p_d - p, log(R_d Rᵀ)),  K = diag(k, k_r),  B = 2 ζ sqrt(K M)

    in the axes of the world at the point held, M the device's mass and inertia. It is passive: its
    energy is ½ eᵀ K e, which only a change of the commanded pose puts in.

    Args:
        device: of the scene, with ``servo``.
        period: of the device's samples, s.
        limits: that hold now; where they allow less stiffness than the scene's, it is less.
    """

    def __init__(self, device: Device, period: float, limits: SafetyLimits) -> None:
        servo = device.servo
        linear = min(
            servo.stiffness or STIFFNESS,
            most_servo_stiffness(device.mass, period, limits.force, limits.force_slew),
        )
        angular = min(
            servo.angular_stiffness or ANGULAR_STIFFNESS,
            most_servo_stiffness(device.inertia, period, limits.torque, limits.torque_slew),
        )
        stiffness = [linear] * 3 + [angular] * 3
        inertia = [device.mass] * 3 + [device.inertia] * 3
        ratio = 2.0 * servo.damping_ratio
        self._stiffness = np.array(stiffness)
        pairs = zip(stiffness, inertia, strict=True)
        self._damping = np.array([ratio * math.sqrt(k * m) for k, m in pairs])

    def wrench(self, goal: pin.SE3, pose: pin.SE3, twist: Array) -> Array:
        """Return the wrench (6,) on the device, N and N m, world axes at the point held.

        Args:
            goal: the commanded pose, in the world.
            pose: of the device, in the world.
            twist: (6,) of the device, m/s and rad/s, world axes at the point held.
        """
        away = np.concatenate(
            (goal.translation - pose.translation, pin.log3(goal.rotation @ pose.rotation.T))
        )
        return np.asarray(self._stiffness * away - self._damping * twist)
