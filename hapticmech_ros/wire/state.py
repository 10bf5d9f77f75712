# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Layout of ``mechanism/state``: all that the analyser needs of a mechanism, in one message.

Flags of the closures, joint coordinates and rates, the contact wrench at every operational point
and the point's place, all of one time.

Names of the coordinates that a JointState carries, for joints of any type.

A joint of one degree of freedom has its own name and its usual position. A joint of several has one
entry per degree of freedom, ``<joint>/0`` and so on: its position relative to the neutral one
(rotation vector of a spherical joint). Positions and velocities then have the same length.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from hapticmech_ros.compilation.records import Field, Layout
from hapticmech_ros.errors import InvalidInputError
from hapticmech_ros.mechanism import Mechanism
from hapticmech_ros.mechanism.closures import GRASP_SIZE, Active
from hapticmech_ros.numerics import Array
from hapticmech_ros.numerics.layout import WRENCH
from hapticmech_ros.numerics.times import NANOSECONDS
from hapticmech_ros.wire.bounds import bounds_of
from hapticmech_ros.wire.messages import FLAG, GRASP_FIELD, STAMP
from hapticmech_ros.wire.stamped import seconds_of


def coordinate_names(mechanism: Mechanism) -> tuple[str, ...]:
    """Return (nv) names in the order of v."""
    names: list[str] = []
    for index, joint in enumerate(mechanism.tree.joint_names):
        part = mechanism.tree.velocity_slice(index)
        size = part.stop - part.start
        names += [joint] if size == 1 else [f"{joint}/{axis}" for axis in range(size)]
    return tuple(names)


_FLAGS = frozenset((0.0, 1.0))


class WireState(NamedTuple):
    """A decoded ``state`` message.

    Attributes:
        stamp_ns: its time, ns.
        active: per closure, whether it is closed.
        q: (nq,) configuration.
        v: (nv,) rates.
        contacts: (points, 6) wrench by the environment on the mechanism at each operational point.
        grasps: (points, 7) place of each operational point: the link's index among the scene's, and
            xyz (m) and rpy (rad) in its frame.
        commanded: per operational point, whether commands for it are received and applied.
    """

    stamp_ns: int
    active: Active
    q: Array
    v: Array
    contacts: Array
    grasps: Array
    commanded: tuple[bool, ...]


class StateColumns(NamedTuple):
    """Many decoded ``state`` messages.

    Attributes:
        stamps_ns: (n,) their times, ns.
        active: (n, closures) whether each closure is closed.
        q: (n, nq) configurations.
        v: (n, nv) rates.
        grasps: (n, points, 7) where each operational point is.
    """

    stamps_ns: npt.NDArray[np.int64]
    active: npt.NDArray[np.bool_]
    q: Array
    v: Array
    grasps: Array


class StateLayout:
    """Packs and unpacks states of one mechanism.

    Attributes:
        fields: name of each part of the flat array -> its size, for the message's label.
        at: where each part is: closed, position, velocity, contact, grasp, commanded.
        bounds: of its numbers, by the limits of the mechanism's scene.
    """

    def __init__(self, mechanism: Mechanism) -> None:
        self._mechanism = mechanism
        self._closures = len(mechanism.closures)
        self._points = len(mechanism.point_names)
        names = coordinate_names(mechanism)
        points, loops = mechanism.point_names, [loop.name for loop in mechanism.closures]
        parts = (
            ("closed", loops, FLAG),
            ("position", names, Field(1, ("joint_position",))),
            ("velocity", names, Field(1, ("joint_velocity",))),
            ("contact", points, Field(6, WRENCH)),
            ("grasp", points, GRASP_FIELD),
            ("commanded", points, FLAG),
        )
        # Each field is named after all that it has numbers of.
        labels = {part: "/".join([part, *of]) for part, of, _ in parts}
        fields = {
            labels[part]: Field(each.size * len(of), each.quantities) for part, of, each in parts
        }
        self.fields = Layout({"stamp": STAMP, **fields})
        self.at = {part: self.fields.slice(label) for part, label in labels.items()}
        self.bounds = bounds_of("state", self.fields, mechanism.scene.limits)

    def pack(self, state: WireState) -> Array:
        """Return the message's data (n,)."""
        # One array of numbers, rather than one of arrays: there are few of them.
        return np.array(
            (
                *seconds_of(state.stamp_ns),
                *state.active,
                *self._mechanism.coordinates(state.q).tolist(),
                *state.v.tolist(),
                *state.contacts.ravel().tolist(),
                *state.grasps.ravel().tolist(),
                *state.commanded,
            ),
            dtype=float,
        )

    def unpack(self, data: object) -> WireState:
        """Return the decoded message.

        Raises:
            InvalidInputError: a flag that is neither 0 nor 1; and as
                :meth:`~hapticmech_ros.wire.bounds.Bounds.stamp`.
        """
        stamp_ns, values = self.bounds.checked(data)
        at, points = self.at, self._points
        numbers = values.tolist()
        flags = (*numbers[at["closed"]], *numbers[at["commanded"]])
        if not _FLAGS.issuperset(flags):
            raise InvalidInputError("flags", list(flags), "must be 0 or 1")
        q = self._mechanism.configuration(values[at["position"]])
        return WireState(
            stamp_ns,
            tuple(map(bool, flags[: self._closures])),
            q,
            values[at["velocity"]],
            values[at["contact"]].reshape(points, 6),
            values[at["grasp"]].reshape(points, GRASP_SIZE),
            tuple(map(bool, flags[self._closures :])),
        )

    def unpack_all(self, data: Array) -> StateColumns:
        """Return columns of n decoded messages, from their data (n, size).

        Args:
            data: (n, size) of messages.

        Raises:
            InvalidInputError: as :meth:`unpack`, for the first message that it refuses.
        """
        at, size = self.at, self.fields.size
        if data.ndim != 2 or data.shape[1] != size:
            raise InvalidInputError("states", data.shape, f"must have shape (n, {size})")
        closed = data[:, at["closed"]]
        flags = np.hstack((closed, data[:, at["commanded"]]))
        well = self.bounds.keeps(data) & ((flags == 0.0) | (flags == 1.0)).all(axis=1)
        if not well.all():
            self.unpack(data[int(np.argmin(well))])
        positions = data[:, at["position"]]
        if self._mechanism.nq == self._mechanism.nv:
            q = positions.copy()
        else:
            q = np.array([self._mechanism.configuration(row) for row in positions])
            q = q.reshape(len(data), self._mechanism.nq)
        seconds, rest = data[:, 0].astype(np.int64), data[:, 1].astype(np.int64)
        return StateColumns(
            seconds * NANOSECONDS + rest,
            closed == 1.0,
            q,
            data[:, at["velocity"]].copy(),
            data[:, at["grasp"]].reshape(len(data), self._points, GRASP_SIZE).copy(),
        )
