"""State of the simulated device at a tick."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pinocchio as pin

from hapticmech_ros.arrays import Array
from hapticmech_ros.quaternions import quaternion_of


@dataclass(frozen=True, slots=True)
class DeviceState:
    """True state of the device, what its encoders said last, and what acts on it.

    Attributes:
        pose: of the point held, in the world.
        twist: (6,) of the point held, world axes.
        measured_pose: pose rounded to encoder steps.
        measured_twist: twist as estimated from the encoders; the true one if they are ideal.
        hand_wrench: (6,) F_h by the hand, as a sensor between it and the device would read it;
            zero if nobody holds.
        applied: (6,) by the actuators until now.
        reported: (6,) what the device says of F_h: measured, estimated or zero.
        home: pose about which the workspace is.
        anchor: pose of the point held when the hand took hold.
        window: in which the hand holds; see :class:`~hapticmech_ros.device.grip.Grip`.
    """

    pose: pin.SE3
    twist: Array
    measured_pose: pin.SE3
    measured_twist: Array
    hand_wrench: Array
    applied: Array
    reported: Array
    home: pin.SE3
    anchor: pin.SE3
    window: int

    def without_force(self) -> DeviceState:
        """Return the same state once the actuators are at zero."""
        return replace(self, applied=np.zeros(6))

    @property
    def published(self) -> Array:
        """What is published of it, (25,): measured position, quaternion, twist and F_h, applied."""
        return np.concatenate(
            (
                self.measured_pose.translation,
                quaternion_of(self.measured_pose.rotation),
                self.measured_twist,
                self.reported,
                self.applied,
            )
        )
