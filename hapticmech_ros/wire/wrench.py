# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""WrenchStamped as bytes on the wire (XCDR1), for the commands of the control rate.

As in :mod:`~hapticmech_ros.wire.cdr`: the message's Python objects would cost more than the rest.
"""

from __future__ import annotations

import struct
from typing import NamedTuple

import numpy as np

from hapticmech_ros.errors import InvalidInputError
from hapticmech_ros.numerics import Array
from hapticmech_ros.wire.bounds import ANY_WRENCH, SixBounds
from hapticmech_ros.wire.stamped import LITTLE_ENDIAN, SIX, WORLD_NAME, seconds_of, stamp_of

WORLD = "world"
# Encapsulation, seconds, nanoseconds, length of the frame's name.
_HEAD = struct.Struct("<4siII")
_SIX = struct.Struct("<6d")


class WireWrench(NamedTuple):
    """A decoded message.

    Attributes:
        stamp_ns: its time, ns; 0 if it was left empty.
        frame: name of the frame; may be empty.
        values: (6,) force and torque, N and N m.
    """

    stamp_ns: int
    frame: str
    values: Array


def encode_wrench(values: Array, stamp_ns: int, bounds: SixBounds = ANY_WRENCH) -> bytes:
    """Return the serialized message of a wrench (6,) in ``world``.

    Args:
        values: (6,) N and N m.
        stamp_ns: its stamp, ns.
        bounds: of the message.

    Raises:
        OutputError: beyond its bounds, not finite, or a time that no stamp can hold.
    """
    six = values.tolist()
    bounds.check_output(six)
    return SIX.pack(LITTLE_ENDIAN, *seconds_of(stamp_ns), len(WORLD_NAME), WORLD_NAME, *six)


def decode_wrench(message: bytes, bounds: SixBounds = ANY_WRENCH) -> WireWrench:
    """Return the contents of a serialized WrenchStamped.

    Raises:
        InvalidInputError: cut short, not little-endian CDR, a stamp that is none, or a wrench
            beyond its bounds or not finite.
    """
    try:
        encapsulation, seconds, nanoseconds, length = _HEAD.unpack_from(message)
        if encapsulation[:2] != LITTLE_ENDIAN[:2]:
            raise InvalidInputError("encapsulation", encapsulation, "must be little-endian CDR")
        frame = bytes(message[16 : 15 + length]).decode("utf-8", "replace")
        # Numbers are aligned to 8 bytes, counted behind the encapsulation.
        six = _SIX.unpack_from(message, 4 + -(-(12 + length) // 8) * 8)
    except struct.error as error:
        rule = "must be a whole WrenchStamped"
        raise InvalidInputError("message", f"{len(message)} bytes: {error}", rule) from None
    bounds.check(six)
    return WireWrench(stamp_of(seconds, nanoseconds), frame, np.array(six))
