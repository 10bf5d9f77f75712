# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Messages that nobody should send: any bytes, and any numbers, by chance that repeats."""

from __future__ import annotations

import struct
import sys
from collections.abc import Sequence
from typing import Any

import numpy as np
from std_msgs.msg import Float64MultiArray, String, UInt8

from hapticmech_ros.numerics.times import NANOSECONDS
from hapticmech_ros.wire.cdr import decode

LARGEST = sys.float_info.max
SMALLEST = 5e-324
EXTREMES = np.array(
    [
        *(LARGEST, -LARGEST, np.nan, np.inf, -np.inf, SMALLEST, -SMALLEST, 1e-310, 0.0, -0.0),
        *(1e200, -1e154, 1e80, -1e80, 1e30, 1e15, -1e9, 1e6, 2.0**31, 2.0**63, -1.0, 0.5),
    ]
)
STAMPS = (0, 1, -1, 2**31 - 1, -(2**31), 1_000_000, 5)
ODD_STAMPS = (LARGEST, -LARGEST, 1e30, np.nan, np.inf, -1.0, 0.5, 2.0**31, 4e9, 1e18, SMALLEST)
# Nothing that is obeyed.
WORDS = (
    *(b"", b"on", b"enabling", b"en able", b"DISABLING", b"pau\0se", b"\xff\xfe", b"__class__"),
    *(b"x" * 10_000, "pausé".encode(), b"%s%n", b"obey", b"publish"),
)
# Numbers behind the frame: of a stamped pose, and of a stamped wrench or twist.
POSE_NUMBERS, SIX = 7, 6


class Hostile:
    """Makes messages.

    Args:
        seed: of chance.
        frames: names of frames that mean something here.
    """

    def __init__(self, seed: int, frames: Sequence[str]) -> None:
        self._rng = np.random.default_rng(seed)
        self._frames = [name.encode() for name in frames]

    def message(self, kind: Any, sample: bytes, now_ns: int) -> bytes:
        """Return a message of a type, made from one that is whole.

        Args:
            kind: the message type.
            sample: a whole message of it.
            now_ns: time at which stamps are fresh, ns.
        """
        rng, way = self._rng, self._rng.random()
        if way < 0.12:
            return self._rng.bytes(int(rng.integers(0, 400)))
        whole = self._numbers(kind, sample, now_ns)
        if way < 0.25:
            return self._flipped(whole)
        if way < 0.33:
            return whole[: int(rng.integers(0, len(whole) + 1))]
        if way < 0.38:
            return whole + self._rng.bytes(int(rng.integers(1, 64)))
        return self._length_changed(whole) if way < 0.41 else whole

    def index(self, count: int) -> int:
        """Return a number below ``count``."""
        return int(self._rng.integers(0, count))

    def _numbers(self, kind: Any, sample: bytes, now_ns: int) -> bytes:
        if kind is UInt8:
            return sample[:4] + self._rng.bytes(1)
        if kind is Float64MultiArray:
            return self._array(sample, now_ns)
        return self._text() if kind is String else self._stamped(kind, now_ns)

    def _text(self) -> bytes:
        """Return a text that commands nothing."""
        text = WORDS[self.index(len(WORDS))]
        if self._rng.random() < 0.3:
            text = self._rng.bytes(int(self._rng.integers(0, 400)))
        return b"\0\1\0\0" + struct.pack("<I", len(text) + 1) + text + b"\0"

    def _array(self, sample: bytes, now_ns: int) -> bytes:
        values = decode(sample).copy()
        if not values.size:
            return sample
        values[2:] = self._changed(values[2:])
        if values.size >= 2:
            fresh = self._rng.random() < 0.8
            values[:2] = divmod(now_ns, NANOSECONDS) if fresh else self._rng.choice(ODD_STAMPS, 2)
        # Its data come last.
        return sample[: -values.nbytes] + values.tobytes()

    def _stamped(self, kind: Any, now_ns: int) -> bytes:
        rng = self._rng
        pose = kind.__name__ == "PoseStamped"
        values = rng.normal(size=POSE_NUMBERS if pose else SIX)
        if pose:
            values[3:] *= 1.0 / np.linalg.norm(values[3:]) if rng.random() < 0.8 else 0.0
        values = self._changed(values)
        seconds, rest = divmod(now_ns, NANOSECONDS)
        if rng.random() < 0.25:
            seconds = (
                int(rng.choice(STAMPS))
                if rng.random() < 0.5
                else seconds + int(rng.integers(-20, 20))
            )
            rest = int(rng.choice((0, 1, 999_999_999, 1_000_000_000, 2**32 - 1)))
        frame = self._frame()
        head = struct.pack("<4siII", b"\0\1\0\0", seconds, rest, len(frame)) + frame
        head += b"\0" * (-(len(head) - 4) % 8)
        return head + values.tobytes()

    def _frame(self) -> bytes:
        way = self._rng.random()
        if way < 0.7:
            return b"world\0"
        if way < 0.85:
            return self._frames[self.index(len(self._frames))] + b"\0"
        return (b"", b"\0", b"\xff\xfe\0", b"wor\0ld\0", b"x" * 3000 + b"\0")[self.index(5)]

    def _changed(self, values: np.ndarray) -> np.ndarray:
        """Return numbers of which some, or all, are others."""
        rng, way = self._rng, self._rng.random()
        values = values.copy()
        if way < 0.35:
            count = int(rng.integers(1, max(2, values.size // 4)))
            values[rng.integers(0, values.size, size=count)] = rng.choice(EXTREMES, count)
        elif way < 0.5:
            values[:] = rng.choice(EXTREMES, values.size)
        elif way < 0.75:
            # Of any size that may be meant, and beyond it.
            sizes = 10.0 ** rng.uniform(-6.0, 8.0, values.size)
            values[:] = np.where(rng.random(values.size) < 0.3, sizes * rng.normal(), values)
        elif way < 0.85:
            values *= 10.0 ** rng.uniform(-3.0, 6.0)
        return values

    def _flipped(self, message: bytes) -> bytes:
        changed = bytearray(message)
        for _ in range(int(self._rng.integers(1, 9)) if changed else 0):
            changed[self.index(len(changed))] ^= 1 << self.index(8)
        return bytes(changed)

    def _length_changed(self, message: bytes) -> bytes:
        """Return a message with one of its counts, or what stands there, made huge."""
        changed = bytearray(message)
        if len(changed) >= 12:
            at = 4 + 4 * self.index((len(changed) - 4) // 4)
            changed[at : at + 4] = self._rng.bytes(4) if self.index(2) else b"\xff\xff\xff\xff"
        return bytes(changed)
