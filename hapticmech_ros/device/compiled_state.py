"""State of the device in the array that kernels fill."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from hapticmech_ros.arrays import Array
from hapticmech_ros.device.kernels import (
    ANCHOR,
    APPLIED,
    BODY,
    HOME,
    OWN,
    PUBLISHED_SIZE,
    REPORTED,
    SEEN,
    WINDOW,
)
from hapticmech_ros.device.state import DeviceState


class CompiledState(DeviceState):
    """A :class:`DeviceState` in one array; its parts are made when asked for.

    Attributes:
        flat: (83,) see :mod:`~hapticmech_ros.device.kernels`.
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
        holding = (*_place(state.home), *_place(state.anchor), (state.window,), state.hand_wrench)
        return cls(np.concatenate((state.published, *body, seen.rotation.ravel(), *holding)))

    def without_force(self) -> CompiledState:
        """Return the same state once the actuators are at zero."""
        flat = self.flat.copy()
        flat[APPLIED:PUBLISHED_SIZE] = 0.0
        return CompiledState(flat)

    @property
    def pose(self) -> pin.SE3:
        """Pose of the point held, in the world."""
        return self._pose_at(BODY)

    @property
    def twist(self) -> Array:
        """(6,) twist of the point held, world axes."""
        return self.flat[BODY + 12 : SEEN]

    @property
    def measured_pose(self) -> pin.SE3:
        """Pose rounded to encoder steps."""
        return pin.SE3(self.flat[SEEN:HOME].reshape(3, 3), self.flat[:3])

    @property
    def measured_twist(self) -> Array:
        """(6,) twist as estimated from the encoders."""
        return self.flat[7:13]

    @property
    def hand_wrench(self) -> Array:
        """(6,) F_h by the hand."""
        return self.flat[OWN:]

    @property
    def applied(self) -> Array:
        """(6,) by the actuators until now."""
        return self.flat[APPLIED:PUBLISHED_SIZE]

    @property
    def reported(self) -> Array:
        """(6,) what the device says of F_h."""
        return self.flat[REPORTED:APPLIED]

    @property
    def home(self) -> pin.SE3:
        """Pose about which the workspace is."""
        return self._pose_at(HOME)

    @property
    def anchor(self) -> pin.SE3:
        """Pose of the point held when the hand took hold."""
        return self._pose_at(ANCHOR)

    @property
    def window(self) -> int:
        """In which the hand holds."""
        return int(self.flat[WINDOW])

    @property
    def published(self) -> Array:
        """What is published of it, (25,)."""
        return self.flat[:PUBLISHED_SIZE]

    def _pose_at(self, start: int) -> pin.SE3:
        rotation = self.flat[start + 3 : start + 12].reshape(3, 3)
        return pin.SE3(rotation, self.flat[start : start + 3])


def _place(pose: pin.SE3) -> tuple[Array, Array]:
    """Return position (3,) and rotation (9,), row by row."""
    return pose.translation, pose.rotation.ravel()
