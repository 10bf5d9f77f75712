# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What writes the messages of :mod:`~hapticmech_ros.wire.messages`, and those of other hands.

``transmission`` and ``device/coupling_gain`` say what other hands do to a point and its device:
their fields depend on the scene.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from hapticmech_ros.compilation.records import Field, Layout
from hapticmech_ros.device import NO_WRENCH, DeviceState
from hapticmech_ros.numerics import Array
from hapticmech_ros.numerics.quaternions import place_of
from hapticmech_ros.operational import Analyser
from hapticmech_ros.operational.observation import Observation, PastRates
from hapticmech_ros.scene.document import Limits
from hapticmech_ros.wire.bounds import (
    Bounds,
    SixBounds,
    bounds_of,
    check_unit,
    message_bounds,
    twist_bounds,
)
from hapticmech_ros.wire.cdr import FlatArray
from hapticmech_ros.wire.kernels import write_operational_model
from hapticmech_ros.wire.messages import (
    STAMP,
    DeviceStateMessage,
    OperationalModelMessage,
)
from hapticmech_ros.wire.stamped import seconds_of
from hapticmech_ros.wire.state import WireState

_PUBLISHED = DeviceStateMessage.layout.slice("position", "applied")


def write_device_state(
    message: DeviceStateMessage,
    state: DeviceState,
    push: Array,
    stamp_ns: int,
    round_trip: float = 0.0,
    obeys: bool = True,
) -> None:
    """Write a state of a device.

    Args:
        message: written.
        state: of the device.
        push: (6,) by others, added to the hand's wrench; N and N m, world axes.
        stamp_ns: ns.
        round_trip: s, from a sample to its answer; 0: not known.
        obeys: whether the device obeys servo_cf.
    """
    message.stamp_ns = stamp_ns
    message.values[_PUBLISHED] = state.published
    message.round_trip, message.obeys = round_trip, obeys
    if push is not NO_WRENCH:
        message.sample.hand_wrench[:] += push


class OperationalModelWriter:
    """An ``operational_model`` message, written anew for each state of the mechanism.

    Args:
        analyser: of the point.
        past: rates of the states that were written before.
        values: (151,) where to write; an array of its own if left out.

    Attributes:
        message: the message.
    """

    def __init__(self, analyser: Analyser, past: PastRates, values: Array | None = None) -> None:
        self._analyser, self._past = analyser, past
        self.message = OperationalModelMessage(values)
        self.message.directions = analyser.rows.size

    def evaluate(self, state: WireState) -> Observation:
        """Write all but the count, and return what was found.

        Raises:
            HapticMechError: the state cannot be analysed.
        """
        before = self._past.before(state.stamp_ns, state.active)
        found = self._analyser.observe(state.q, state.v, state.active, before=before)
        self._past.add(state.stamp_ns, state.v, state.active)
        at = self._analyser.index
        reported = state.contacts[at], float(state.commanded[at]), state.grasps[at]
        write_operational_model(self.message, state.stamp_ns, found.model, *reported)
        return found


class ReadingBounds(NamedTuple):
    """Bounds of what a controller reads: ``device/state``, ``operational_model``, and twists."""

    device: Bounds
    model: Bounds
    twist: SixBounds


def reading_bounds(limits: Limits) -> ReadingBounds:
    """Return the bounds of a scene's limits."""
    return ReadingBounds(
        message_bounds(DeviceStateMessage, limits),
        message_bounds(OperationalModelMessage, limits),
        twist_bounds(limits),
    )


def pose_of(position: Array, quaternion: Array) -> pin.SE3:
    """Return the pose of a position (3,), m, and a quaternion (4,), x, y, z, w.

    Args:
        position: (3,) m.
        quaternion: (4,) x, y, z, w.

    Raises:
        InvalidInputError: a quaternion off unit length by more than 1e-3.
    """
    check_unit(quaternion)
    return place_of(np.concatenate((position, quaternion)))


_SQUARE = Field(36, ("ratio",))


class CouplingMatrices(NamedTuple):
    """A decoded message.

    Attributes:
        stamp_ns: of the mechanism's state, ns; of ``coupling_gain``, that of the device's sample
            that its command answers.
        by_point: (6, 6) by operational point that another hand holds: Y_ij, or H_j; 1, m and 1/m.
    """

    stamp_ns: int
    by_point: Mapping[str, Array]


class CouplingWire:
    """Layout of both messages: a stamp, and a matrix per other operational point.

    Args:
        others: operational points, in the scene's order.
        limits: of the scene.

    Attributes:
        fields: of the messages.
        bounds: of their numbers.
    """

    def __init__(self, others: Iterable[str], limits: Limits) -> None:
        self._others = tuple(others)
        matrices = dict.fromkeys(self._others, _SQUARE)
        self.fields = Layout({"stamp": STAMP, **matrices})
        self.bounds: Bounds = bounds_of("coupling", self.fields, limits)
        self._array = FlatArray(self.fields, self.bounds)

    def encode(self, found: CouplingMatrices) -> bytes:
        """Return the serialized message.

        Raises:
            OutputError: a number beyond its bounds, or a time that no stamp can hold.
        """
        return self._array.encode(self.pack(found))

    def pack(self, found: CouplingMatrices) -> Array:
        """Return a message's data (n,); zero for a point that ``by_point`` has not."""
        values = np.zeros(self.fields.size)
        values[:2] = seconds_of(found.stamp_ns)
        for name, matrix in found.by_point.items():
            values[self.fields.slice(name)] = matrix.ravel()
        return values

    def unpack(self, data: object) -> CouplingMatrices:
        """Return the decoded message, without matrices that are zero.

        Raises:
            InvalidInputError: as :meth:`~hapticmech_ros.wire.bounds.Bounds.stamp`.
        """
        stamp, values = self.bounds.checked(data)
        parts = {name: values[self.fields.slice(name)] for name in self._others}
        matrices = {name: part.reshape(6, 6) for name, part in parts.items() if part.any()}
        return CouplingMatrices(stamp, matrices)
