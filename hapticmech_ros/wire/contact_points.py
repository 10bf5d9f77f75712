"""Layout of ``mechanism/contacts``: every point of contact of a mechanism, in one message.

A stamp, and eleven numbers for each point, so that the message is as long as there are points.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from hapticmech_ros.errors import InvalidInputError
from hapticmech_ros.mechanism.model import Array
from hapticmech_ros.wire.bounds import bounds_of
from hapticmech_ros.wire.cdr import FlatArray
from hapticmech_ros.wire.layouts import checked_values
from hapticmech_ros.wire.stamps import seconds_of

if TYPE_CHECKING:
    from hapticmech_ros.contact.touching import Touching

STAMP, PER_POINT = 2, 11


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
        """Return the serialized message of what touches; None: nothing does."""
        count = 0 if touching is None else touching.pairs.size
        values = np.zeros(STAMP + PER_POINT * count)
        values[:STAMP] = seconds_of(time_ns)
        if touching is not None and count:
            rows = values[STAMP:].reshape(count, PER_POINT)
            rows[:, 0], rows[:, 7] = touching.pairs, touching.depths
            rows[:, 1:4], rows[:, 4:7] = touching.points, touching.normals
            rows[:, 8:] = touching.forces
        flat = self._flat.get(count)
        if flat is None:
            flat = self._flat[count] = FlatArray(self._fields(count))
        return flat.encode(values)

    def unpack(self, data: Array) -> ContactPoints:
        """Return the decoded message.

        Raises:
            InvalidInputError: wrong length, not finite, or a pair that the scene has not.
        """
        count = max(0, (len(data) - STAMP) // PER_POINT)
        bounds = bounds_of("contacts", self._fields(count))
        stamp_ns, values = checked_values(data, bounds)
        rows = values[STAMP:].reshape(count, PER_POINT)
        pairs = np.clip(rows[:, 0], -1.0, self._pairs).astype(np.int64)
        wrong = (pairs != rows[:, 0]) | (pairs < 0) | (pairs >= self._pairs)
        if wrong.any():
            rule = f"must be an index of the scene's {self._pairs} contacts"
            raise InvalidInputError("pair", float(rows[np.argmax(wrong), 0]), rule)
        return ContactPoints(stamp_ns, pairs, rows[:, 1:4], rows[:, 4:7], rows[:, 7], rows[:, 8:])

    def _fields(self, count: int) -> dict[str, int]:
        return {"stamp": STAMP, self._label: PER_POINT * count}
