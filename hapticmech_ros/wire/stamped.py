# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""PoseStamped, TwistStamped and JointState as bytes on the wire (XCDR1), in ``world``.

As in :mod:`~hapticmech_ros.wire.cdr`: the messages' Python objects would cost several times as
much. WrenchStamped is in :mod:`~hapticmech_ros.wire.wrench`. Stamps are two numbers, which are
checked before any use.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Sequence

from hapticmech_ros.errors import InvalidInputError, OutputError
from hapticmech_ros.numerics.times import NANOSECONDS

# builtin_interfaces/Time has seconds in 32 bits with a sign: it ends in January 2038.
LAST_SECOND = 2**31 - 1
LAST_NS = (LAST_SECOND + 1) * NANOSECONDS - 1
_RULE = f"must be whole numbers, seconds from 0 to {LAST_SECOND}, nanoseconds from 0 to 999999999"


def stamp_of(seconds: float, nanoseconds: float) -> int:
    """Return a message's stamp, ns.

    Raises:
        InvalidInputError: negative, no whole number, or beyond the range of a stamp.
    """
    whole = 0 <= seconds <= LAST_SECOND and 0 <= nanoseconds < NANOSECONDS
    # After the range check: NaN fails it, and int() of NaN would raise.
    if not whole or seconds != int(seconds) or nanoseconds != int(nanoseconds):
        raise InvalidInputError("stamp, s and ns", (seconds, nanoseconds), _RULE)
    return int(seconds) * NANOSECONDS + int(nanoseconds)


def nearest_stamp(time_ns: int) -> int:
    """Return the time, ns, that a stamp can hold and that is nearest to one that it may not.

    For messages that must be sent at any time: zero wrenches, and faults.
    """
    return min(max(time_ns, 0), LAST_NS)


def seconds_of(time_ns: int) -> tuple[int, int]:
    """Return a time as a stamp has it, in s and ns.

    Raises:
        OutputError: before 1970, or beyond the range of a stamp.
    """
    if not 0 <= time_ns <= LAST_NS:
        rule = f"seconds must be from 0 to {LAST_SECOND}, as builtin_interfaces/Time has them"
        raise OutputError("stamp, s", time_ns / NANOSECONDS, rule)
    return divmod(time_ns, NANOSECONDS)


# Encapsulation, seconds, nanoseconds, length of the frame's name; the name; numbers, aligned.
SIX = struct.Struct("<4siII6s6x6d")
_SEVEN = struct.Struct("<4siII6s6x7d")
_STAMP = struct.Struct("<4siI")
LITTLE_ENDIAN = b"\x00\x01\x00\x00"
WORLD_NAME = b"world\0"


def encode_twist(twist: Sequence[float], stamp_ns: int) -> bytes:
    """Return the serialized TwistStamped.

    Args:
        twist: (6,) linear and angular velocity, m/s and rad/s.
        stamp_ns: its stamp, ns.

    Raises:
        OutputError: numbers that are not finite, or a time that no stamp can hold.
    """
    _check("twist", twist)
    return SIX.pack(LITTLE_ENDIAN, *seconds_of(stamp_ns), len(WORLD_NAME), WORLD_NAME, *twist)


def encode_pose(place: Sequence[float], stamp_ns: int) -> bytes:
    """Return the serialized PoseStamped.

    Args:
        place: (7,) position, m, and quaternion x, y, z, w.
        stamp_ns: its stamp, ns.

    Raises:
        OutputError: numbers that are not finite, or a time that no stamp can hold.
    """
    _check("pose", place)
    return _SEVEN.pack(LITTLE_ENDIAN, *seconds_of(stamp_ns), len(WORLD_NAME), WORLD_NAME, *place)


def with_text(body: bytes, text: str) -> bytes:
    """Return a message's body with a text behind it, at the next multiple of 4 bytes."""
    label = text.encode() + b"\0"
    return body + b"\0" * (-len(body) % 4) + struct.pack("<I", len(label)) + label


class JointStateWriter:
    """JointState messages of the same joints.

    Args:
        names: of the joints.
    """

    def __init__(self, names: Sequence[str]) -> None:
        # Counted from the stamp, which is 8 bytes.
        body = with_text(b"", "world")
        body += b"\0" * (-len(body) % 4) + struct.pack("<I", len(names))
        for name in names:
            body = with_text(body, name)
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
        message = _STAMP.pack(LITTLE_ENDIAN, *seconds_of(stamp_ns)) + self._names
        for what, values in (("position", position), ("velocity", velocity), ("effort", effort)):
            _check(what, values)
            message += struct.pack("<I", len(values))
            if values:
                message += b"\0" * (-(len(message) - len(LITTLE_ENDIAN)) % 8)
                message += struct.pack(f"<{len(values)}d", *values)
        return message


def _check(what: str, values: Sequence[float]) -> None:
    for at, value in enumerate(values):
        if not math.isfinite(value):
            raise OutputError(f"{what}[{at}]", value, "must be finite")
