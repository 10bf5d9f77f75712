# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Layout of ``mechanism/contacts``: every point of contact of a mechanism, in one message.

A stamp, and eleven numbers for each point: the message's length depends on their number.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from hapticmech_ros.compilation.records import Field, Layout
from hapticmech_ros.errors import InvalidInputError
from hapticmech_ros.numerics import Array
from hapticmech_ros.wire.bounds import bounds_of
from hapticmech_ros.wire.cdr import FlatArray
from hapticmech_ros.wire.messages import STAMP
from hapticmech_ros.wire.stamped import seconds_of

if TYPE_CHECKING:
    from hapticmech_ros.contact.memory import Touching

# Of each point: index of its pair among the scene's contacts, where it is, m, the unit normal from
# b to a, depth, m, and force by b on a, N.
POINT = Layout(
    {"pair": Field(1), "point": Field(3), "normal": Field(3), "depth": Field(1), "force": Field(3)}
)
_PAIR, _DEPTH = POINT.start("pair"), POINT.start("depth")
_PLACE, _NORMAL, _FORCE = POINT.slice("point"), POINT.slice("normal"), POINT.slice("force")


class ContactPoints(NamedTuple):
    """A decoded ``contacts`` message; n points, in order of their pairs.

    Attributes:
        stamp_ns: time of the state that the step led to, ns.
        pairs: (n,) index of each point's pair among the scene's contacts.
        points: (n, 3) m, in ``world``.
        normals: (n, 3) unit normals from b to a, axes of ``world``.
        depths: (n,) m; below 0 for a gap.
        forces: (n, 3) by b, on a, N, axes of ``world``.
    """

    stamp_ns: int
    pairs: Array
    points: Array
    normals: Array
    depths: Array
    forces: Array


class ContactLayout:
    """Writes and reads the points of contact of one scene.

    Args:
        names: of the scene's contacts.
    """

    def __init__(self, names: Sequence[str]) -> None:
        self._pairs = len(names)
        self._label = "/".join(["points", *names])
        self._flat: dict[int, FlatArray] = {}

    def encode(self, touching: Touching | None, time_ns: int) -> bytes:
        """Return the serialized message of contact points; None without any."""
        rows = np.zeros((0, POINT.size))
        if touching is not None:
            rows = np.column_stack(
                (
                    touching.pairs,
                    touching.points,
                    touching.normals,
                    touching.depths,
                    touching.forces,
                )
            )
        count = len(rows)
        if count not in self._flat:
            self._flat[count] = FlatArray(self._fields(count))
        values = np.concatenate((seconds_of(time_ns), rows.ravel()))
        return self._flat[count].encode(values)

    def unpack(self, data: Array) -> ContactPoints:
        """Return the decoded message.

        Args:
            data: (n,) of a message.

        Raises:
            InvalidInputError: wrong length, not finite, or a pair that the scene has not.
        """
        count = max(0, (len(data) - STAMP.size) // POINT.size)
        bounds = bounds_of("contacts", self._fields(count))
        stamp_ns, values = bounds.checked(data)
        rows = values[STAMP.size :].reshape(count, POINT.size)
        indices = rows[:, _PAIR]
        pairs = np.clip(indices, -1.0, self._pairs).astype(np.int64)
        wrong = (pairs != indices) | (pairs < 0) | (pairs >= self._pairs)
        if wrong.any():
            rule = f"must be an index of the scene's {self._pairs} contacts"
            raise InvalidInputError("pair", float(indices[np.argmax(wrong)]), rule)
        places, normals, depths = rows[:, _PLACE], rows[:, _NORMAL], rows[:, _DEPTH]
        return ContactPoints(stamp_ns, pairs, places, normals, depths, rows[:, _FORCE])

    def _fields(self, count: int) -> Layout:
        return Layout({"stamp": STAMP, self._label: Field(POINT.size * count)})
