"""Messages between nodes of one process, handed over without the middleware.

As rclcpp's intra-process communication does, which rclpy has not: a serialized message goes
straight to the listeners in this process, and to the middleware only when somebody outside listens
too. What then comes back to this process through the middleware is dropped. Outside, nothing looks
different.
"""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable
from typing import Any, Protocol

from hapticmech_ros.nodes.sent_numbers import check_finite

# How many messages may be on their way through the middleware back to this process.
MOST_UNDERWAY = 1024
# How long an answer holds to the question of who listens: asked each time it would cost as much as
# a message. Somebody new outside hears a topic at most so much later.
CENSUS_NS = 20_000_000

Listener = Callable[[bytes], None]


class Publishes(Protocol):
    """What is needed of an rclpy publisher."""

    def publish(self, message: Any) -> None:
        """Send a message, or its bytes."""

    def get_subscription_count(self) -> int:
        """Return how many subscriptions it has met, those of this process included."""


class _Line:
    """One topic in this process: who listens, and what else is under way to them outside."""

    __slots__ = ("listeners", "underway")

    def __init__(self) -> None:
        self.listeners: list[Listener] = []
        self.underway: dict[bytes, None] = {}


class Outlet:
    """A publisher that knows who listens.

    Args:
        exchange: of the process.
        publisher: to those outside.
        line: the topic in this process.
        stays: whether a message is kept for those who come later, and so must always be sent.
    """

    def __init__(
        self, exchange: Exchange, publisher: Publishes, line: _Line, stays: bool = False
    ) -> None:
        self.publisher = publisher
        self._exchange = exchange
        self._line = line
        self._stays = stays
        self._readers = 0
        self._census_ns = -CENSUS_NS

    @property
    def wanted(self) -> bool:
        """Whether anybody would get a message."""
        return self._stays or self.publisher.get_subscription_count() > 0

    def publish(self, message: Any) -> None:
        """Send a message, or its bytes, to all who listen.

        Raises:
            OutputError: a message with numbers that are not finite; those in bytes were looked at
                when they were written.
        """
        line = self._line
        if type(message) is not bytes:
            if self.wanted:
                check_finite(message)
                self.publisher.publish(message)
            return
        if not line.listeners:
            self.publisher.publish(message)
            return
        if self._stays or self._count() > len(line.listeners):
            underway = line.underway
            underway[message] = None
            if len(underway) > MOST_UNDERWAY:
                del underway[next(iter(underway))]
            self.publisher.publish(message)
        self._exchange.send(line.listeners, message)

    def _count(self) -> int:
        """Return how many subscriptions there are, those of this process included."""
        now = time.monotonic_ns()
        if now - self._census_ns >= CENSUS_NS:
            self._census_ns = now
            self._readers = self.publisher.get_subscription_count()
        return self._readers


class Exchange:
    """Joins the nodes of one process, which all run in one thread.

    Messages are delivered by :meth:`deliver`, in the order in which they were published, and never
    from within another message's callback.
    """

    def __init__(self) -> None:
        self._lines: dict[str, _Line] = {}
        self._waiting: deque[tuple[Listener, bytes]] = deque()
        self._delivering = False

    def outlet(self, publisher: Publishes, topic: str, stays: bool) -> Outlet:
        """Return what to publish a topic (its full name) through."""
        return Outlet(self, publisher, self._line(topic), stays)

    def listen(self, topic: str, listener: Listener) -> Callable[[bytes], bool]:
        """Hand a topic's messages to ``listener``.

        Its subscription must hear the same topic, raw. Returned is what tells of a message that it
        brings whether it is one of this process, which has been handed over already.
        """
        line = self._line(topic)
        line.listeners.append(listener)
        return line.underway.__contains__

    def silence(self, topic: str, listener: Listener) -> None:
        """Hand over no more; what waits for the listener is dropped."""
        self._line(topic).listeners.remove(listener)
        self._waiting = deque(pair for pair in self._waiting if pair[0] != listener)

    def send(self, listeners: list[Listener], message: bytes) -> None:
        """Let a message wait for its listeners."""
        for listener in listeners:
            self._waiting.append((listener, message))

    def deliver(self) -> None:
        """Hand over what waits, and what is published meanwhile."""
        if self._delivering:
            return
        self._delivering = True
        try:
            while self._waiting:
                listener, message = self._waiting.popleft()
                listener(message)
        finally:
            self._delivering = False

    def _line(self, topic: str) -> _Line:
        return self._lines.setdefault(topic, _Line())
