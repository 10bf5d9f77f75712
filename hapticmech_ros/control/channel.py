# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The connection between device and controller: late, uneven and lossy messages, for tests.

What is sent, and what arrives of it, is in :mod:`~hapticmech_ros.control.channel_kernels`.
"""

from __future__ import annotations

import math

import numpy as np

from hapticmech_ros.arrays import Array
from hapticmech_ros.control.channel_kernels import (
    LOST,
    NEWEST,
    SLOT_SIZE,
    SLOTS,
    STREAM,
    TAG,
    mixed,
    receive_message,
    send_message,
)
from hapticmech_ros.errors import InvalidInputError
from hapticmech_ros.scene.controller import Connection


class Channel:
    """One direction of a connection.

    Args:
        connection: how late, uneven and lossy.
        direction: 0 or 1, so that both have random numbers of their own.
        size: n, numbers of a message.
        period: s, between messages.

    Attributes:
        state: whole numbers; see :mod:`~hapticmech_ros.control.channel_kernels`.
        rows: (slots + 1, n) messages on the way, and the one that was received last.
        law: delay, s, jitter and loss, shares.

    Raises:
        InvalidInputError: another direction.
    """

    def __init__(self, connection: Connection, direction: int, size: int, period: float) -> None:
        if direction not in (0, 1):
            raise InvalidInputError("direction", direction, "must be 0 or 1")
        self.law = connection.delay, connection.jitter, connection.loss
        # On the way at once: one for each period of the longest delay, and the one just sent.
        slots = math.ceil(connection.delay * (1.0 + connection.jitter) / period) + 2
        self.state: Array = np.zeros(SLOTS + SLOT_SIZE * slots, dtype=np.int64)
        self.rows: Array = np.zeros((slots + 1, size))
        self.state[NEWEST] = -1
        self.state[SLOTS + 1 :: SLOT_SIZE] = -1
        with np.errstate(over="ignore"):
            stream = np.uint64(mixed(2 * connection.seed + direction))
        self.state[STREAM] = stream.view(np.int64)

    @property
    def lost(self) -> int:
        """Messages that were lost."""
        return int(self.state[LOST])

    @property
    def tag(self) -> int:
        """The number that came with the message that was received last."""
        return int(self.state[TAG])

    def put(self, time_ns: int, message: Array, tag: int = 0) -> None:
        """Send a message (n,) at a time (ns), and a whole number with it.

        Args:
            time_ns: when it is sent, ns.
            message: (n,).
            tag: a whole number sent with it.

        Raises:
            InvalidInputError: messages are sent more often than once in a period.
        """
        if not send_message(self.state, self.rows, *self.law, time_ns, tag, message):
            raise InvalidInputError("time", time_ns, "must be a period after the last message (ns)")

    def take(self, time_ns: int) -> Array | None:
        """Return the newest message (n,) since the last call, a view; None if none arrived."""
        return self.rows[-1] if receive_message(self.state, self.rows, time_ns) else None
