# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""State of the simulated device at a tick, and the interface that a session needs of any device."""

from __future__ import annotations

from operator import attrgetter
from typing import Any, Protocol

import numpy as np
import pinocchio as pin

from hapticmech_ros.device.hand_kernels import Place
from hapticmech_ros.device.kernels import PublishedState, SimulatedState
from hapticmech_ros.errors import check_one_of
from hapticmech_ros.numerics import Array
from hapticmech_ros.numerics.quaternions import quaternion_of

NO_WRENCH = np.zeros(6)
NO_WRENCH.flags.writeable = False
# Fields of a state by the names of its parts: poses, and numbers.
_PLACES = {"pose": "body", "home": "home", "anchor": "anchor", "limb": "limb"}
_NUMBERS = {
    "twist": "body.twist",
    "measured_twist": "twist",
    "hand_wrench": "own",
    "applied": "applied",
    "reported": "hand_wrench",
    "window": "window",
    "limb_twist": "limb.twist",
    "pull": "pull",
}


class DeviceState:
    """True state of the device, its encoders' last measurement, and the wrenches on it.

    It is one array, which kernels work on; its parts are views of it, or made on access.

    Args:
        flat: (107,) a :class:`~hapticmech_ros.device.kernels.SimulatedState`, which it keeps.
    """

    __slots__ = ("_numbers",)

    def __init__(self, flat: Array) -> None:
        self._numbers = SimulatedState(flat)

    def __repr__(self) -> str:
        x, y, z = self.pose.translation
        return f"DeviceState at ({x:.4g}, {y:.4g}, {z:.4g}) m"

    @classmethod
    def resting(cls, pose: pin.SE3) -> DeviceState:
        """Return a state at rest at a pose, ideal encoders, with nothing that acts and no hand."""
        state = cls(SimulatedState().values)
        places = dict.fromkeys(("pose", "measured_pose", "home", "anchor", "limb"), pose)
        return state.replaced(**places, window=-1)

    def replaced(self, **parts: Any) -> DeviceState:
        """Return a copy of the same kind with other parts.

        Args:
            parts: by the names of the properties, in their shapes; all but ``published``.

        Raises:
            InvalidInputError: a state has no such part.
        """
        changed = type(self)(self.flat.copy())
        numbers = changed._numbers
        for name, value in parts.items():
            check_one_of("part of a state", name, (*_PLACES, "measured_pose", *_NUMBERS))
            if name in _PLACES:
                place = getattr(numbers, _PLACES[name])
                place.position[:], place.rotation[:] = value.translation, value.rotation
            elif name == "measured_pose":
                turn = value.rotation
                numbers.fill(position=value.translation, seen=turn, quaternion=quaternion_of(turn))
            elif name == "window":
                numbers.window = value
            else:
                attrgetter(_NUMBERS[name])(numbers)[:] = value
        return changed

    def without_force(self) -> DeviceState:
        """Return the same state once the actuators are at zero."""
        return self.replaced(applied=NO_WRENCH)

    @property
    def flat(self) -> Array:
        """(107,) all its numbers, see :class:`~hapticmech_ros.device.kernels.SimulatedState`."""
        return self._numbers.values

    @property
    def pose(self) -> pin.SE3:
        """Pose of the point held, in the world."""
        return _pose_of(self._numbers.body)

    @property
    def twist(self) -> Array:
        """(6,) twist of the point held, m/s and rad/s, world axes."""
        return self._numbers.body.twist

    @property
    def measured_pose(self) -> pin.SE3:
        """Pose rounded to encoder steps."""
        return pin.SE3(self._numbers.seen, self._numbers.position)

    @property
    def measured_twist(self) -> Array:
        """(6,) m/s and rad/s, estimated from the encoders; the true twist if they are ideal."""
        return self._numbers.twist

    @property
    def hand_wrench(self) -> Array:
        """(6,) F_h by the hand, as a sensor between it and the device would read it.

        N and N m, world axes at the point held; zero if no hand holds.
        """
        return self._numbers.own

    @property
    def applied(self) -> Array:
        """(6,) by the actuators at this time, N and N m, world axes at the point held."""
        return self._numbers.applied

    @property
    def reported(self) -> Array:
        """(6,) F_h as reported: measured, estimated or zero; N and N m, world axes."""
        return self._numbers.hand_wrench

    @property
    def home(self) -> pin.SE3:
        """Pose about which the workspace is."""
        return _pose_of(self._numbers.home)

    @property
    def anchor(self) -> pin.SE3:
        """Pose of the point held when the hand took hold."""
        return _pose_of(self._numbers.anchor)

    @property
    def window(self) -> int:
        """In which the hand holds; see :mod:`~hapticmech_ros.device.hand_kernels`."""
        return int(self._numbers.window)

    @property
    def limb(self) -> pin.SE3:
        """Pose of the hand's mass behind a grip; where the hand took hold without one."""
        return _pose_of(self._numbers.limb)

    @property
    def limb_twist(self) -> Array:
        """(6,) twist of that mass, m/s and rad/s, world axes."""
        return self._numbers.limb.twist

    @property
    def pull(self) -> Array:
        """(6,) by the arm on that mass, N and N m, world axes."""
        return self._numbers.pull

    @property
    def published(self) -> Array:
        """Its published part, (25,): measured sample and applied wrench, SI, world axes."""
        return PublishedState(self.flat).values


def _pose_of(place: Place) -> pin.SE3:
    return pin.SE3(place.rotation, place.position)


class SimulatedDevice(Protocol):
    """A device that a session can hold and move: ``Session(scene, device=...)``.

    A session reads the published part of the states that it returns, and ``pose`` of the first one;
    it passes each unchanged to the next step. A device that needs more than a
    :class:`~hapticmech_ros.device.state.DeviceState` returns a subclass of that.
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
            held: state in which the hand could take hold; None without a hand.
            ticks: whole periods since then, until ``state``.
            push: (6,) by others than the hand, on the device, N and N m, world axes.
        """
        ...

    def compensation(self, state: DeviceState) -> Array:
        """Return the wrench (6,) that the driver adds over the next period, N, N m, world axes."""
        ...

    def sensed(self, push: Array) -> Array:
        """Return the part (6,) of others' ``push`` that a force sensor, if any, adds to the hand's.

        Args:
            push: (6,) by others on the device, N and N m, world axes at the point held.
        """
        ...
