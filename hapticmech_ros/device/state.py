"""State of the simulated device at a tick."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from hapticmech_ros.mechanism.model import Array
from hapticmech_ros.quaternions import quaternion_of


@dataclass(frozen=True, slots=True)
class DeviceState:
    """True state of the device, what its encoders said last, and what acts on it.

    Attributes:
        pose: of the point held, in the world.
        twist: (6,) of the point held, world axes.
        measured_pose: pose rounded to encoder steps.
        measured_twist: twist as estimated from the encoders; the true one if they are ideal.
        hand_wrench: (6,) F_h of the hand's own law at this state, zero if nobody holds.
        applied: (6,) by the actuators until now.
    """

    pose: pin.SE3
    twist: Array
    measured_pose: pin.SE3
    measured_twist: Array
    hand_wrench: Array
    applied: Array

    @property
    def published(self) -> Array:
        """What is published of it, (25,): measured position, quaternion and twist, F_h, applied."""
        return np.concatenate(
            (
                self.measured_pose.translation,
                quaternion_of(self.measured_pose.rotation),
                self.measured_twist,
                self.hand_wrench,
                self.applied,
            )
        )
