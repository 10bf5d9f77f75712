# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What people and CRTK clients read of a device."""

from __future__ import annotations

from typing import Any

import pinocchio as pin
from geometry_msgs.msg import PoseStamped, TwistStamped, WrenchStamped
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray

from hapticmech_ros.arrays import Array
from hapticmech_ros.control.passivity import PassivityController
from hapticmech_ros.device import DeviceState
from hapticmech_ros.nodes.actor import Actor
from hapticmech_ros.quaternions import quaternion_of
from hapticmech_ros.wire.cdr import FlatArray
from hapticmech_ros.wire.layouts import (
    DEVICE_ENERGY_FIELDS,
    DeviceEnergy,
    pack_device_energy,
)
from hapticmech_ros.wire.stamped import JointStateWriter, encode_pose, encode_twist
from hapticmech_ros.wire.topics import (
    DEVICE_ENERGY,
    DEVICE_FORCE,
    DEVICE_JOINTS,
    DEVICE_POSE,
    DEVICE_SETPOINT,
    DEVICE_TWIST,
    HAND_FORCE,
)
from hapticmech_ros.wire.wrench import encode_wrench

# The six coordinates as joints: metres, and the rotation vector's components in radians.
COORDINATES = ("x", "y", "z", "rx", "ry", "rz")


class DeviceView:
    """A device's CRTK topics.

    Args:
        actor: the device's.
    """

    def __init__(self, actor: Actor[Any]) -> None:
        self._joints = JointStateWriter(COORDINATES)
        self._publish_hand = actor.view(HAND_FORCE, WrenchStamped)
        self._publish_force = actor.view(DEVICE_FORCE, WrenchStamped)
        self._publish_twist = actor.view(DEVICE_TWIST, TwistStamped)
        self._publish_setpoint = actor.view(DEVICE_SETPOINT, WrenchStamped)
        self._publish_joints = actor.view(DEVICE_JOINTS, JointState)
        self._energy = FlatArray(DEVICE_ENERGY_FIELDS)
        self._publish_energy = actor.view(DEVICE_ENERGY, Float64MultiArray)
        self._publish_pose = actor.view(DEVICE_POSE, PoseStamped)

    def publish_energy(self, account: PassivityController, sample: Array, time_ns: int) -> None:
        """Publish a device's energies at a sample (19,), at a time (ns).

        Args:
            account: of passivity.
            sample: (19,) of the device, in SI units; see ``layout.DEVICE_SAMPLE``.
            time_ns: ns.
        """
        if not self._publish_energy.wanted:
            return
        energy = DeviceEnergy(
            time_ns,
            account.hand(sample),
            account.actuators,
            account.mechanism or 0.0,
            account.available,
            account.dissipated,
        )
        self._publish_energy.publish(self._energy.encode(pack_device_energy(energy)))

    def publish(self, state: DeviceState, hand_wrench: Array, time_ns: int) -> None:
        """Publish a state with the wrench (6,) of all that push, at a time (ns).

        Args:
            state: of the device.
            hand_wrench: (6,) F_h, N and N m, world axes at the point held.
            time_ns: ns.
        """
        pose, twist, applied = state.measured_pose, state.measured_twist, state.applied
        if self._publish_hand.wanted:
            self._publish_hand.publish(encode_wrench(hand_wrench, time_ns))
        if self._publish_force.wanted:
            self._publish_force.publish(encode_wrench(applied, time_ns))
        if self._publish_twist.wanted:
            self._publish_twist.publish(encode_twist(twist.tolist(), time_ns))
        if self._publish_setpoint.wanted:
            self._publish_setpoint.publish(encode_wrench(applied, time_ns))
        if self._publish_joints.wanted:
            self._publish_joints.publish(self._coordinates(pose, twist, applied, time_ns))
        # Last of the sample: who speaks CRTK only answers the pose.
        if self._publish_pose.wanted:
            place = *pose.translation.tolist(), *quaternion_of(pose.rotation).tolist()
            self._publish_pose.publish(encode_pose(place, time_ns))

    def _coordinates(self, pose: pin.SE3, twist: Array, applied: Array, time_ns: int) -> bytes:
        """Return the six coordinates, their rates, and torques that do the same work with them."""
        turned = pin.log3(pose.rotation)
        spin = pose.rotation @ pin.Jexp3(turned)
        rates = pin.Jlog3(pose.rotation) @ pose.rotation.T @ twist[3:]
        return self._joints.encode(
            [*pose.translation.tolist(), *turned.tolist()],
            [*twist[:3].tolist(), *rates.tolist()],
            [*applied[:3].tolist(), *(spin.T @ applied[3:]).tolist()],
            time_ns,
        )
