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
from hapticmech_ros.nodes.messages import WORLD, set_stamp, write_pose, write_twist, write_wrench
from hapticmech_ros.wire.cdr import FlatArray
from hapticmech_ros.wire.energy_topics import DEVICE_ENERGY
from hapticmech_ros.wire.port_energies import (
    DEVICE_ENERGY_FIELDS,
    DeviceEnergy,
    pack_device_energy,
)
from hapticmech_ros.wire.topics import (
    DEVICE_FORCE,
    DEVICE_JOINTS,
    DEVICE_POSE,
    DEVICE_SETPOINT,
    DEVICE_TWIST,
)

# The six coordinates as joints: metres, and the rotation vector's components in radians.
COORDINATES = ("x", "y", "z", "rx", "ry", "rz")


class DeviceView:
    """A device's CRTK topics.

    Args:
        actor: the device's.
    """

    def __init__(self, actor: Actor[Any]) -> None:
        self._pose, self._twist, self._force = PoseStamped(), TwistStamped(), WrenchStamped()
        self._setpoint, self._joints = WrenchStamped(), JointState(name=list(COORDINATES))
        self._joints.header.frame_id = WORLD
        self._publish_force = actor.output(DEVICE_FORCE, WrenchStamped)
        self._publish_twist = actor.output(DEVICE_TWIST, TwistStamped)
        self._publish_setpoint = actor.output(DEVICE_SETPOINT, WrenchStamped)
        self._publish_joints = actor.output(DEVICE_JOINTS, JointState)
        self._energy = FlatArray(DEVICE_ENERGY_FIELDS)
        self._publish_energy = actor.output(DEVICE_ENERGY, Float64MultiArray)
        self._publish_pose = actor.output(DEVICE_POSE, PoseStamped)

    def publish_energy(self, account: PassivityController, sample: Array, time_ns: int) -> None:
        """Publish a device's energies at a sample (19,), at a time (ns).

        Args:
            account: of passivity.
            sample: (19,) of the device, in SI units; see ``layout.DEVICE_SAMPLE``.
            time_ns: ns.
        """
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
        write_wrench(self._force, hand_wrench, time_ns)
        write_twist(self._twist, twist, time_ns)
        write_pose(self._pose, pose, time_ns)
        self._publish_force.publish(self._force)
        self._publish_twist.publish(self._twist)
        write_wrench(self._setpoint, applied, time_ns)
        self._publish_setpoint.publish(self._setpoint)
        turned = pin.log3(pose.rotation)
        # Rates of the rotation vector, and torques that do the same work with them.
        spin = pose.rotation @ pin.Jexp3(turned)
        rates = pin.Jlog3(pose.rotation) @ pose.rotation.T @ twist[3:]
        set_stamp(self._joints.header.stamp, time_ns)
        self._joints.position = [*pose.translation.tolist(), *turned.tolist()]
        self._joints.velocity = [*twist[:3].tolist(), *rates.tolist()]
        self._joints.effort = [*applied[:3].tolist(), *(spin.T @ applied[3:]).tolist()]
        self._publish_joints.publish(self._joints)
        # Last of the sample: who speaks CRTK only answers the pose.
        self._publish_pose.publish(self._pose)
