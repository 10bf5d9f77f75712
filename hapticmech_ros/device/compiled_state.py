"""State of the device in the array that kernels fill."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from hapticmech_ros.device.kernels import BODY, PUBLISHED_SIZE, SEEN
from hapticmech_ros.device.state import DeviceState
from hapticmech_ros.mechanism.model import Array


class CompiledState(DeviceState):
    """A :class:`DeviceState` in one array; its parts are made when asked for.

    Attributes:
        flat: (52,) see :mod:`~hapticmech_ros.device.kernels`.
    """

    __slots__ = ("flat",)
    flat: Array

    def __init__(self, flat: Array) -> None:
        object.__setattr__(self, "flat", flat)  # the parent is frozen

    @classmethod
    def of(cls, state: DeviceState) -> CompiledState:
        """Return a state of any kind as an array."""
        pose, seen = state.pose, state.measured_pose
        body = (pose.translation, pose.rotation.ravel(), state.twist)
        return cls(np.concatenate((state.published, *body, seen.rotation.ravel())))

    @property
    def pose(self) -> pin.SE3:
        """Pose of the point held, in the world."""
        return pin.SE3(self.flat[BODY + 3 : BODY + 12].reshape(3, 3), self.flat[BODY : BODY + 3])

    @property
    def twist(self) -> Array:
        """(6,) twist of the point held, world axes."""
        return self.flat[BODY + 12 : SEEN]

    @property
    def measured_pose(self) -> pin.SE3:
        """Pose rounded to encoder steps."""
        return pin.SE3(self.flat[SEEN:].reshape(3, 3), self.flat[:3])

    @property
    def measured_twist(self) -> Array:
        """(6,) twist as estimated from the encoders."""
        return self.flat[7:13]

    @property
    def hand_wrench(self) -> Array:
        """(6,) F_h of the hand's own law."""
        return self.flat[13:19]

    @property
    def applied(self) -> Array:
        """(6,) by the actuators until now."""
        return self.flat[19:PUBLISHED_SIZE]

    @property
    def published(self) -> Array:
        """What is published of it, (25,)."""
        return self.flat[:PUBLISHED_SIZE]
