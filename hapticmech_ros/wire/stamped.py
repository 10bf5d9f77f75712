# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""PoseStamped, TwistStamped and JointState as bytes on the wire (XCDR1), in ``world``.

As in :mod:`~hapticmech_ros.wire.cdr`: the messages' Python objects would cost several times as
much. WrenchStamped is in :mod:`~hapticmech_ros.wire.wrench`.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Sequence

from hapticmech_ros.errors import OutputError
from hapticmech_ros.wire.stamps import seconds_of

# Encapsulation, seconds, nanoseconds, length of the frame's name; the name; numbers, aligned.
_SIX = struct.Struct("<4siII6s6x6d")
_SEVEN = struct.Struct("<4siII6s6x7d")
_STAMP = struct.Struct("<4siI")
_LITTLE_ENDIAN = b"\x00\x01\x00\x00"
_NAME = b"world\0"


def encode_twist(twist: Sequence[float], stamp_ns: int) -> bytes:
    """Return the serialized TwistStamped.

    Args:
        twist: (6,) linear and angular velocity, m/s and rad/s.
        stamp_ns: its stamp, ns.

    Raises:
        OutputError: numbers that are not finite, or a time that no stamp can hold.
    """
    _check("twist", twist)
    return _SIX.pack(_LITTLE_ENDIAN, *seconds_of(stamp_ns), len(_NAME), _NAME, *twist)


def encode_pose(place: Sequence[float], stamp_ns: int) -> bytes:
    """Return the serialized PoseStamped.

    Args:
        place: (7,) position, m, and quaternion x, y, z, w.
        stamp_ns: its stamp, ns.

    Raises:
        OutputError: numbers that are not finite, or a time that no stamp can hold.
    """
    _check("pose", place)
    return _SEVEN.pack(_LITTLE_ENDIAN, *seconds_of(stamp_ns), len(_NAME), _NAME, *place)


class JointStateWriter:
    """JointState messages of the same joints.

    Args:
        names: of the joints.
    """

    def __init__(self, names: Sequence[str]) -> None:
        body = struct.pack("<I", len(_NAME)) + _NAME
        # Counted from the stamp, which is 8 bytes.
        body += b"\0" * (-len(body) % 4) + struct.pack("<I", len(names))
        for name in names:
            label = name.encode() + b"\0"
            body += b"\0" * (-len(body) % 4) + struct.pack("<I", len(label)) + label
        self._names = body + b"\0" * (-len(body) % 4)

    def encode(
        self,
        position: Sequence[float],
        velocity: Sequence[float],
        effort: Sequence[float],
        stamp_ns: int,
    ) -> bytes:
        """Return the serialized message.

        Args:
            position: (n,) rad or m.
            velocity: (n,) rad/s or m/s.
            effort: (n,) N m or N; empty: none.
            stamp_ns: its stamp, ns.

        Raises:
            OutputError: numbers that are not finite, or a time that no stamp can hold.
        """
        message = _STAMP.pack(_LITTLE_ENDIAN, *seconds_of(stamp_ns)) + self._names
        for what, values in (("position", position), ("velocity", velocity), ("effort", effort)):
            _check(what, values)
            message += struct.pack("<I", len(values))
            if values:
                message += b"\0" * (-(len(message) - len(_LITTLE_ENDIAN)) % 8)
                message += struct.pack(f"<{len(values)}d", *values)
        return message


def _check(what: str, values: Sequence[float]) -> None:
    for at, value in enumerate(values):
        if not math.isfinite(value):
            raise OutputError(f"{what}[{at}]", value, "must be finite")
