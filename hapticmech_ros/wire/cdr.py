# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Float64MultiArray as bytes on the wire (XCDR1), for the messages of the control rate.

It writes and reads them without building the message's Python objects, which would take longer than
the physics. Written messages are ordinary ones, with one labelled dimension; messages read may have
any layout.
"""

from __future__ import annotations

import struct
from collections.abc import Mapping, Sequence

import numpy as np

from hapticmech_ros.errors import InvalidInputError, OutputError
from hapticmech_ros.numerics import Array
from hapticmech_ros.wire.bounds import Bounds
from hapticmech_ros.wire.stamped import LITTLE_ENDIAN, stamp_of, with_text

_HEADER = len(LITTLE_ENDIAN)


class FlatArray:
    """Messages that carry one flat array of named fields.

    Args:
        fields: name -> size, in order; becomes the label of the message's one dimension.
        bounds: of sent numbers; None: any finite numbers.

    Attributes:
        size: how many numbers a message has.
        prefix: its bytes before these.
    """

    def __init__(self, fields: Mapping[str, int], bounds: Bounds | None = None) -> None:
        self._bounds = bounds
        self.size = sum(fields.values())
        label = ",".join(f"{name}:{size}" for name, size in fields.items())
        self.prefix = _before_data([(label, self.size, self.size)], self.size)
        self._length = len(self.prefix) + 8 * self.size

    def encode(self, values: Array) -> bytes:
        """Return the serialized message.

        Args:
            values: (n,) the data.

        Raises:
            InvalidInputError: not ``size`` numbers.
            OutputError: numbers that are not finite, or beyond their bounds.
        """
        if values.shape != (self.size,):
            raise InvalidInputError("array", values.shape, f"must have shape ({self.size},)")
        values = np.ascontiguousarray(values, dtype="<f8")
        if self._bounds is not None:
            self._bounds.check_output(values)
        else:
            _check_finite(values)
        return self.prefix + values.tobytes()

    def decode(self, message: bytes) -> Array:
        """Return the data (n,) of a serialized message, of this layout or of any other, read-only.

        Raises:
            InvalidInputError: as :func:`decode`.
        """
        if len(message) == self._length and message.startswith(self.prefix):
            return np.frombuffer(message, "<f8", self.size, len(self.prefix))
        return decode(message)

    def decode_all(self, messages: Sequence[bytes]) -> Array:
        """Return the data (n, size) of n serialized messages, of this layout or of any other.

        Raises:
            InvalidInputError: as :func:`decode`, or not ``size`` numbers.
        """
        length, prefix = self._length, self.prefix
        if all(len(message) == length and message.startswith(prefix) for message in messages):
            rows = np.frombuffer(b"".join(messages), np.uint8).reshape(len(messages), length)
            return np.ascontiguousarray(rows[:, len(prefix) :]).view("<f8")
        found = np.empty((len(messages), self.size))
        for row, message in zip(found, messages, strict=True):
            values = self.decode(message)
            if values.shape != (self.size,):
                raise InvalidInputError("array", values.shape, f"must have shape ({self.size},)")
            row[:] = values
        return found


def encode_matrix(row: str, column: str, matrix: Array) -> bytes:
    """Return the serialized message of a matrix (n, m), row by row.

    Args:
        row: label of the first dimension.
        column: of the second.
        matrix: (n, m).

    Raises:
        OutputError: numbers that are not finite.
    """
    rows, columns = matrix.shape
    values = np.ascontiguousarray(matrix, dtype="<f8").ravel()
    _check_finite(values)
    dimensions = [(row, rows, rows * columns), (column, columns, columns)]
    return _before_data(dimensions, values.size) + values.tobytes()


def encode_byte(value: int) -> bytes:
    """Return the serialized message of a UInt8, filled up to whole words as the middleware does.

    Raises:
        OutputError: beyond 0 to 255.
    """
    if not 0 <= value <= 255:
        raise OutputError("data", value, "must be within 0 to 255")
    return LITTLE_ENDIAN + bytes((value, 0, 0, 0))


def _before_data(dimensions: Sequence[tuple[str, int, int]], count: int) -> bytes:
    """Return a message up to its data: label, size and stride of each dimension, and counts."""
    body = struct.pack("<I", len(dimensions))
    for name, size, stride in dimensions:
        body = with_text(body, name)
        body += b"\0" * (-len(body) % 4) + struct.pack("<II", size, stride)
    # Offset of the data, and their number; numbers are aligned, if there are any.
    body += struct.pack("<II", 0, count)
    if count:
        body += b"\0" * (-len(body) % 8)
    return LITTLE_ENDIAN + body


def _check_finite(values: Array) -> None:
    if not np.isfinite(values).all():
        at = int(np.flatnonzero(~np.isfinite(values))[0])
        raise OutputError(f"array[{at}]", float(values[at]), "must be finite")


def decode(message: bytes) -> Array:
    """Return the data (n,) of a serialized Float64MultiArray, read-only.

    Raises:
        InvalidInputError: cut short, or not such a message.
    """
    if message[:2] != LITTLE_ENDIAN[:2]:
        raise InvalidInputError("encapsulation", message[:2], "must be little-endian CDR")
    try:
        at = _HEADER
        (dimensions,) = struct.unpack_from("<I", message, at)
        at += 4
        for _ in range(dimensions):
            at += -(at - _HEADER) % 4
            (length,) = struct.unpack_from("<I", message, at)
            at += 4 + length
            at += -(at - _HEADER) % 4 + 8
        _, count = struct.unpack_from("<II", message, at)
        at += 8
        if count:
            at += -(at - _HEADER) % 8
        return np.frombuffer(message, dtype="<f8", count=count, offset=at)
    except (struct.error, ValueError) as error:
        rule = "must be a whole Float64MultiArray"
        raise InvalidInputError("message", f"{len(message)} bytes: {error}", rule) from None


def header_stamp(message: bytes) -> int:
    """Return the stamp (ns) of a serialized message that begins with a std_msgs/Header.

    Raises:
        InvalidInputError: cut short, not little-endian CDR, or a stamp that is none.
    """
    if message[:2] != LITTLE_ENDIAN[:2] or len(message) < _HEADER + 8:
        raise InvalidInputError(
            "message", message[:12], "must be a whole little-endian CDR message"
        )
    seconds, nanoseconds = struct.unpack_from("<iI", message, _HEADER)
    return stamp_of(seconds, nanoseconds)


def array_stamp(message: bytes) -> int:
    """Return the stamp (ns) of a serialized flat array whose first two numbers it is.

    Raises:
        InvalidInputError: cut short, not a Float64MultiArray of two numbers and more, or a stamp
            that is none.
    """
    values = decode(message)
    if values.size < 2:
        raise InvalidInputError("array", values.size, "must begin with seconds and nanoseconds")
    return stamp_of(*values[:2].tolist())
