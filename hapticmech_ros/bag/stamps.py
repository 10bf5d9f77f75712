# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The sender's stamp of a serialized message, read without decoding the message.

Stamped are messages whose first field is a header or a time, and the flat arrays of this package,
whose label says ``stamp:2`` first: seconds and nanoseconds.
"""

from __future__ import annotations

import struct
from collections.abc import Callable

from hapticmech_ros.times import NANOSECONDS

ARRAY = "std_msgs/msg/Float64MultiArray"
# Type of a first field that begins with a stamp.
_FIRST = ("std_msgs/msg/Header", "builtin_interfaces/msg/Time")
_LABEL = b"stamp:2,"
_HEADER = 4


def stamp_reader(msgtype: str, first_type: str) -> Callable[[bytes], int | None] | None:
    """Return what reads stamps (ns) from messages of a type, or None if it has none.

    The reader returns None for a message that is too short, or an array without a stamp.

    Args:
        msgtype: such as ``geometry_msgs/msg/PoseStamped``.
        first_type: message type of its first field; empty if that is a plain value.
    """
    if first_type in _FIRST:
        return _leading
    return _labelled if msgtype == ARRAY else None


def flat_fields(label: str) -> dict[str, int]:
    """Return names and sizes of a label ``name:size,name:size``; empty if it is another label."""
    found: dict[str, int] = {}
    for part in label.split(","):
        name, _, size = part.rpartition(":")
        if not name or not size.isdigit():
            return {}
        found[name] = int(size)
    return found


def _leading(message: bytes) -> int | None:
    try:
        seconds, nanoseconds = struct.unpack_from(f"{_order(message)}iI", message, _HEADER)
    except struct.error:
        return None
    return int(seconds) * NANOSECONDS + int(nanoseconds)


def _labelled(message: bytes) -> int | None:
    order = _order(message)
    try:
        dimensions, length = struct.unpack_from(f"{order}II", message, _HEADER)
        at = _HEADER + 8
        if dimensions != 1 or message[at : at + len(_LABEL)] != _LABEL:
            return None
        at += length
        # Size, stride and offset precede the length of the data, on multiples of four.
        at += -(at - _HEADER) % 4 + 12
        (count,) = struct.unpack_from(f"{order}I", message, at)
        at += 4
        at += -(at - _HEADER) % 8
        if count < 2:
            return None
        seconds, nanoseconds = struct.unpack_from(f"{order}dd", message, at)
        return int(seconds) * NANOSECONDS + int(nanoseconds)
    except (struct.error, ValueError, OverflowError):
        return None


def _order(message: bytes) -> str:
    return "<" if message[1:2] == b"\x01" else ">"
