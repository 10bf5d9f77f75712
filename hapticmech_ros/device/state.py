# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""State of the simulated device at a tick, and what a session asks of any device."""

from __future__ import annotations

from typing import Any, Protocol

import numpy as np
import pinocchio as pin

from hapticmech_ros.device.kernels import DEVICE_STATE
from hapticmech_ros.errors import InvalidInputError
from hapticmech_ros.numerics import Array
from hapticmech_ros.numerics.quaternions import quaternion_of

NO_WRENCH = np.zeros(6)
NO_WRENCH.flags.writeable = False
# Where in the array its parts are: poses, and what is numbers.
_PLACES = {
    part: DEVICE_STATE.start(name)
    for part, name in (("pose", "body"), ("home", "home"), ("anchor", "anchor"), ("limb", "limb"))
}
_POSITION, _QUATERNION, _SEEN = (
    DEVICE_STATE.slice(name) for name in ("position", "quaternion", "seen")
)
_PUBLISHED = DEVICE_STATE.slice("position", "applied")
_NUMBERS = {
    part: DEVICE_STATE.slice(name)
    for part, name in (
        ("twist", "body_twist"),
        ("measured_twist", "twist"),
        ("hand_wrench", "own"),
        ("applied", "applied"),
        ("reported", "hand_wrench"),
        ("window", "window"),
        ("limb_twist", "limb_twist"),
        ("pull", "pull"),
    )
}
_TWIST, _MEASURED_TWIST, _OWN, _APPLIED, _REPORTED, _WINDOW, _LIMB_TWIST, _PULL = _NUMBERS.values()


class DeviceState:
    """True state of the device, what its encoders said last, and what acts on it.

    It is one array, which kernels work on; its parts are views of it, or made when asked for.

    Args:
        flat: (107,) a :data:`~hapticmech_ros.device.kernels.DEVICE_STATE`, which it keeps.
    """

    __slots__ = ("flat",)
    flat: Array

    def __init__(self, flat: Array) -> None:
        self.flat = flat

    def __repr__(self) -> str:
        x, y, z = self.pose.translation
        return f"DeviceState at ({x:.4g}, {y:.4g}, {z:.4g}) m"

    @classmethod
    def resting(cls, pose: pin.SE3) -> DeviceState:
        """Return a state at rest at a pose, ideal encoders, with nothing that acts and no hand."""
        state = cls(np.zeros(DEVICE_STATE.size))
        places = dict.fromkeys(("pose", "measured_pose", "home", "anchor", "limb"), pose)
        return state.replaced(**places, window=-1)

    def replaced(self, **parts: Any) -> DeviceState:
        """Return a copy of the same kind with other parts.

        Args:
            parts: by the names of the properties, in their shapes; all but ``published``.

        Raises:
            InvalidInputError: a state has no such part.
        """
        flat = self.flat.copy()
        for name, value in parts.items():
            if name in _PLACES:
                start = _PLACES[name]
                flat[start : start + 3] = value.translation
                flat[start + 3 : start + 12] = value.rotation.ravel()
            elif name == "measured_pose":
                flat[_POSITION], flat[_SEEN] = value.translation, value.rotation.ravel()
                flat[_QUATERNION] = quaternion_of(value.rotation)
            elif name in _NUMBERS:
                flat[_NUMBERS[name]] = value
            else:
                known = ", ".join((*_PLACES, "measured_pose", *_NUMBERS))
                raise InvalidInputError("part of a state", name, f"must be one of {known}")
        return type(self)(flat)

    def without_force(self) -> DeviceState:
        """Return the same state once the actuators are at zero."""
        return self.replaced(applied=NO_WRENCH)

    @property
    def pose(self) -> pin.SE3:
        """Pose of the point held, in the world."""
        return self._pose_at("pose")

    @property
    def twist(self) -> Array:
        """(6,) twist of the point held, m/s and rad/s, world axes."""
        return self.flat[_TWIST]

    @property
    def measured_pose(self) -> pin.SE3:
        """Pose rounded to encoder steps."""
        return pin.SE3(self.flat[_SEEN].reshape(3, 3), self.flat[_POSITION])

    @property
    def measured_twist(self) -> Array:
        """(6,) m/s and rad/s, estimated from the encoders; the true twist if they are ideal."""
        return self.flat[_MEASURED_TWIST]

    @property
    def hand_wrench(self) -> Array:
        """(6,) F_h by the hand, as a sensor between it and the device would read it.

        N and N m, world axes at the point held; zero if nobody holds.
        """
        return self.flat[_OWN]

    @property
    def applied(self) -> Array:
        """(6,) by the actuators at this time, N and N m, world axes at the point held."""
        return self.flat[_APPLIED]

    @property
    def reported(self) -> Array:
        """(6,) F_h as reported: measured, estimated or zero; N and N m, world axes."""
        return self.flat[_REPORTED]

    @property
    def home(self) -> pin.SE3:
        """Pose about which the workspace is."""
        return self._pose_at("home")

    @property
    def anchor(self) -> pin.SE3:
        """Pose of the point held when the hand took hold."""
        return self._pose_at("anchor")

    @property
    def window(self) -> int:
        """In which the hand holds; see :mod:`~hapticmech_ros.device.hand_kernels`."""
        return int(self.flat[_WINDOW][0])

    @property
    def limb(self) -> pin.SE3:
        """Pose of the hand's mass behind a grip; where the hand took hold without one."""
        return self._pose_at("limb")

    @property
    def limb_twist(self) -> Array:
        """(6,) twist of that mass, m/s and rad/s, world axes."""
        return self.flat[_LIMB_TWIST]

    @property
    def pull(self) -> Array:
        """(6,) by the arm on that mass, N and N m, world axes."""
        return self.flat[_PULL]

    @property
    def published(self) -> Array:
        """What is published of it, (25,): measured sample and applied wrench, SI, world axes."""
        return self.flat[_PUBLISHED]

    def _pose_at(self, name: str) -> pin.SE3:
        start = _PLACES[name]
        rotation = self.flat[start + 3 : start + 12].reshape(3, 3)
        return pin.SE3(rotation, self.flat[start : start + 3])


class SimulatedDevice(Protocol):
    """A device that a session can hold and move: ``Session(scene, device=...)``.

    Of the states that it returns a session reads what is published of them, and ``pose`` of the
    first one; it hands each back to the next step as it is. One that needs more than a
    :class:`~hapticmech_ros.device.state.DeviceState` has room for is a subclass of that.
    """

    def at_rest(
        self, pose: pin.SE3, held: bool = False, home: pin.SE3 | None = None
    ) -> DeviceState:
        """Return the device standing still.

        Args:
            pose: where, in the world.
            held: whether the hand can take hold now.
            home: pose about which the workspace is; ``pose`` if left out.
        """
        ...

    def step(
        self,
        state: DeviceState,
        command: Array | None,
        held: DeviceState | None,
        ticks: int,
        push: Array = NO_WRENCH,
    ) -> DeviceState:
        """Return the state one period later; ``state`` is left as it is.

        Args:
            state: where to start.
            command: (6,) servo_cf, N and N m, on the hand by the device, world axes, held over the
                period; None for actuators off, compensation included.
            held: state in which the hand could take hold; None if nobody is there.
            ticks: whole periods since then, until ``state``.
            push: (6,) by others than the hand, on the device, N and N m, world axes.
        """
        ...

    def compensation(self, state: DeviceState) -> Array:
        """Return the wrench (6,) that the driver adds over the next period, N, N m, world axes."""
        ...

    def sensed(self, push: Array) -> Array:
        """Return what a force sensor, if any, reads of others' ``push`` (6,) besides the hand's.

        Args:
            push: (6,) by others on the device, N and N m, world axes at the point held.
        """
        ...
