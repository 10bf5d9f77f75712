# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The connection between device and controller: late, uneven and lossy messages, for tests.

What is sent at t arrives at t + d (1 + j u), u evenly spread between -1 and 1, or not at all.
Whoever receives takes the newest that has arrived; one that a later one has overtaken is dropped.
Random numbers are a function of seed, direction and the message's number: the same connection
gives the same bits, in a session and in a graph.
"""

from __future__ import annotations

from collections import deque
from typing import Generic, TypeVar

from hapticmech_ros.errors import InvalidInputError
from hapticmech_ros.scene.controller import Connection
from hapticmech_ros.times import NANOSECONDS

T = TypeVar("T")
_MASK = (1 << 64) - 1
# Two numbers, of delay and loss, for each message in each direction.
_DRAWS = 2


class DelayLine(Generic[T]):
    """One direction of a connection.

    Args:
        connection: how late, uneven and lossy.
        direction: 0 or 1, so that both have random numbers of their own.
    """

    def __init__(self, connection: Connection, direction: int) -> None:
        if direction not in (0, 1):
            raise InvalidInputError("direction", direction, "must be 0 or 1")
        self._connection = connection
        self._stream = _mixed(2 * connection.seed + direction)
        self._sent = 0
        # Time of arrival, ns, number, and what.
        self._on_the_way: deque[tuple[int, int, T]] = deque()
        self._newest = -1
        self.lost = 0

    def put(self, time_ns: int, message: T) -> None:
        """Send a message at a time (ns)."""
        number, connection = self._sent, self._connection
        self._sent += 1
        if connection.loss > 0.0 and self._drawn(_DRAWS * number) < connection.loss:
            self.lost += 1
            return
        uneven = 2.0 * self._drawn(_DRAWS * number + 1) - 1.0 if connection.jitter > 0.0 else 0.0
        late = connection.delay * (1.0 + connection.jitter * uneven)
        self._on_the_way.append((time_ns + round(late * NANOSECONDS), number, message))

    def take(self, time_ns: int) -> T | None:
        """Return the newest message that has arrived since the last call; None if none has."""
        found: T | None = None
        waiting = []
        for arrival in self._on_the_way:
            due, number, message = arrival
            if due > time_ns:
                waiting.append(arrival)
            elif number > self._newest:
                self._newest, found = number, message
        self._on_the_way = deque(waiting)
        return found

    def _drawn(self, index: int) -> float:
        """Return the random number of an index, in [0, 1)."""
        return _mixed(self._stream + index) / (_MASK + 1)


def _mixed(number: int) -> int:
    """Return 64 bits without any pattern: SplitMix64 (Steele, Lea, Flood 2014)."""
    number = (number + 1) * 0x9E3779B97F4A7C15 & _MASK
    number = (number ^ number >> 30) * 0xBF58476D1CE4E5B9 & _MASK
    number = (number ^ number >> 27) * 0x94D049BB133111EB & _MASK
    return number ^ number >> 31
