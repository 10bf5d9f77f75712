# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A node's messages: over the lane within this user and host, by the middleware to all others.

A serialized message is sent over the lane (:mod:`~hapticmech_ros.nodes.lane`) to the topic's
subscribers there, and published by the middleware only if it has further subscribers. Subscribers
on the lane then drop the middleware's copies. Other programs see no difference.
"""

from __future__ import annotations

import ctypes
import threading
import time
from collections import deque
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from functools import cache, partial
from typing import Any, NamedTuple, Protocol

from hapticmech_ros.nodes.lane import MOST_BYTES, Arrived, Lane, LaneError
from hapticmech_ros.nodes.messages import check_finite
from hapticmech_ros.nodes.sources import BatchListener, Listener
from hapticmech_ros.nodes.turn import Turn
from hapticmech_ros.numerics.times import NANOSECONDS

# How many messages received over the lane are remembered to recognize the middleware's copies, and
# for how long, ns. A recorder that gets little processor time may take the copies seconds later.
MOST_UNDERWAY = 10_000
UNDERWAY_NS = 10 * NANOSECONDS
# How long a count of subscriptions is reused, ns: counting costs as much as sending a message. A
# new subscriber outside the lane receives a topic at most this much later.
CENSUS_NS = 20_000_000
# The same for topics outside the control loop.
VIEW_CENSUS_NS = 100_000_000
# For this long after a change of the lane's subscribers the middleware carries messages too, ns: it
# may discover the change later.
SETTLES_NS = NANOSECONDS // 4
# Least time between two stops of a kernel for subscriptions' callbacks, ns.
CALLS_NS = 8_000_000
# The middleware may deliver a copy before the kernel has read the message: it is given so long, ns.
READS_NS = 2_500_000
# Most messages that wait for the loop to have time.
MOST_LATER = 200


class Publishes(Protocol):
    """The part of an rclpy publisher that is used here."""

    def publish(self, message: Any) -> None:
        """Send a message, or its bytes."""

    def get_subscription_count(self) -> int:
        """Return the number of matched subscriptions, those of this process included."""


# An actor's ``Failures.met``.
Meet = Callable[[str, Exception], None]
# Of all nodes with one thread: it does nothing.
_ALONE = Turn()


@cache
def _rcl_publishes() -> int:
    """Return the address of ``rcl_publish_serialized_message``, with which rclpy sends bytes."""
    from rclpy.impl.implementation_singleton import rclpy_implementation

    library = ctypes.CDLL(rclpy_implementation.__file__)
    found = ctypes.cast(library.rcl_publish_serialized_message, ctypes.c_void_p).value
    return found or 0


class _Copies:
    """Messages of a topic received over the lane that the middleware delivers too."""

    __slots__ = ("underway",)

    def __init__(self) -> None:
        # Hash of each message, and when it was received, ns: whole messages would take megabytes.
        self.underway: dict[int, int] = {}

    def note(self, message: bytes) -> None:
        """Note a message of which the middleware will deliver a copy."""
        underway = self.underway
        underway[hash(message)] = time.monotonic_ns()
        if len(underway) > MOST_UNDERWAY:
            del underway[next(iter(underway))]

    def had(self, message: bytes) -> bool:
        """Return whether the middleware's message is a copy of one noted within UNDERWAY_NS."""
        noted = self.underway.get(hash(message))
        return noted is not None and time.monotonic_ns() - noted < UNDERWAY_NS


class _Deferred(NamedTuple):
    """A subscription's callback that waits until the kernel is stopped.

    Attributes:
        topic: full name and type on the lane.
        message: its bytes.
        callback: with the message bound.
    """

    topic: str
    message: bytes
    callback: Callable[[], object]


class Outlet:
    """A publisher that uses the lane, the middleware or both, depending on the subscribers.

    Args:
        exchange: of the node.
        publisher: of the middleware.
        topic: full name and type on the lane; empty: the topic does not use the lane.
        number: of this outlet, unique in the node.
        stays: whether the middleware keeps messages for late subscribers: they are always sent.
        later: whether a serialized message may wait until the loop has nothing else to do.

    Attributes:
        topic, number: as given.
        published: number of messages sent through the middleware, those by :attr:`rcl` included.
    """

    def __init__(
        self,
        exchange: Exchange,
        publisher: Publishes,
        topic: str,
        number: int,
        stays: bool = False,
        later: bool = False,
    ) -> None:
        self.publisher = publisher
        self.later = later
        self.topic = topic
        self.number = number
        self._exchange = exchange
        self._stays = stays
        self.published = 0
        self._readers = 0
        self._census_ns = -CENSUS_NS
        self._on_lane = 0
        self._settled_ns = 0
        # Views are published by several threads.
        self._lock = threading.Lock()

    @property
    def wanted(self) -> bool:
        """Whether a message has a subscriber, or must be sent for late ones."""
        lane = self._exchange.lane if self.topic else None
        reached = self._stays or (lane is not None and lane.readers(self.topic) > 0)
        return reached or self.publisher.get_subscription_count() > 0

    def publish(self, message: Any) -> None:
        """Send a message, or its bytes, to all subscribers.

        Raises:
            OutputError: a message has numbers that are not finite; bytes were checked when they
                were encoded.
        """
        if type(message) is not bytes:
            if self.wanted:
                check_finite(message)
                self.publish_outside(message)
        elif self.later and self._exchange.may_wait:
            self._exchange.publish_later(self, message)
        else:
            self.publish_bytes(message)

    def offer(self, encode: Callable[..., Any], *arguments: Any) -> None:
        """Publish ``encode(*arguments)``, a message or its bytes, if anybody receives it."""
        if self.wanted:
            self.publish(encode(*arguments))

    def publish_bytes(self, message: bytes) -> None:
        """Send a serialized message over the lane, the middleware or both, to all subscribers."""
        with self._lock:
            self._publish(message)

    def _publish(self, message: bytes) -> None:
        lane = self._exchange.lane
        if not self.topic or len(message) > MOST_BYTES:
            lane = None
        readers = 0 if lane is None else lane.readers(self.topic)
        now = time.monotonic_ns()
        if readers != self._on_lane:
            self._on_lane, self._settled_ns = readers, now + SETTLES_NS
        if lane is None or not readers:
            self.publish_outside(message)
            return
        both = self._stays or now < self._settled_ns or self._count(now) > readers
        # Over the lane first, so that a subscriber to both recognizes the middleware's copy.
        lane.send(self.topic, self.number, self.published + both, message, both)
        if both:
            self.publish_outside(message)

    @property
    def rcl(self) -> tuple[int, int]:
        """Addresses of rcl's function that publishes bytes, and of rcl's publisher; or zeros."""
        handle = getattr(self.publisher, "handle", None)
        return (0, 0) if handle is None else (_rcl_publishes(), handle.pointer)

    @property
    def way(self) -> bool | None:
        """Whether a message would be sent by the middleware, also where it goes over the lane.

        None if the number of subscribers on the lane has changed since the last message, or if the
        middleware keeps messages for late subscribers.
        """
        lane, now = self._exchange.lane, time.monotonic_ns()
        readers = lane.readers(self.topic) if lane and self.topic else 0
        if readers != self._on_lane or self._stays or not self.topic:
            return None
        return (readers > 0 and now < self._settled_ns) or self._count(now) > readers

    def ways(self) -> str:
        """Return how a message would be sent now: lane, middleware, both or nobody."""
        lane = self._exchange.lane if self.topic else None
        readers = lane.readers(self.topic) if lane else 0
        ways = {
            "lane": readers > 0,
            "middleware": self._stays
            or time.monotonic_ns() < self._settled_ns
            or self.publisher.get_subscription_count() > readers,
        }
        return ", ".join(way for way, goes in ways.items() if goes) or "nobody"

    def publish_outside(self, message: Any) -> None:
        """Send a message, or its bytes, through the middleware, and count it."""
        self.published += 1
        self.publisher.publish(message)

    def _count(self, now: int) -> int:
        """Return the number of subscriptions, those on the lane included, as counted lately."""
        if now - self._census_ns >= (VIEW_CENSUS_NS if self.later else CENSUS_NS):
            self._census_ns = now
            self._readers = self.publisher.get_subscription_count()
        return self._readers


class Exchange:
    """A node's messages over the lane and by the middleware.

    :meth:`deliver` passes messages from the lane to their callbacks, in the order of arrival, and
    never from within another message's callback.

    Attributes:
        lane: to other nodes of this host; None: all messages use the middleware.
        refusal: why :meth:`join_lane` could not open a lane; else empty.
    """

    def __init__(self) -> None:
        self.lane: Lane | None = None
        self.refusal = ""
        self._copies: dict[str, _Copies] = {}
        self._failed: deque[Callable[[], None]] = deque()
        self._deferred: deque[_Deferred] = deque()
        self._called_ns = self._due_ns = 0
        self._waiting: deque[Arrived] = deque()
        self._later: deque[tuple[Outlet, bytes]] = deque()
        self._delivering = False
        self._outlets = 0

    @property
    def turn(self) -> Turn:
        """Turn of the node's threads."""
        return _ALONE if self.lane is None else self.lane.turn

    @property
    def settled(self) -> bool:
        """Whether the node's Python state includes all that its kernel has done."""
        wait = None if self.lane is None else self.lane.wait
        return wait is None or wait.settled

    def settle(self) -> None:
        """Update the node's Python state from its kernel, before a callback runs."""
        if self.lane is not None and self.lane.wait is not None:
            self.lane.wait.settle()
            self._note_copied(self.lane)

    @contextmanager
    def taken(self, rings: bool = False) -> Iterator[None]:
        """Return a context for a callback: kernels are stopped, and the node's state is settled.

        Args:
            rings: whether to wake the loop afterwards, so that it checks its deadlines.
        """
        turn = self.turn
        with turn.taken():
            self.settle()
            if turn.is_of_loop:
                yield
                return
            # The loop may wait for long, and older messages must go before those published next.
            self.publish_kept()
            while self._deferred:
                self._deferred.popleft().callback()
            yield
            self._called_ns = time.monotonic_ns()
            if rings:
                turn.ring()

    def defer(self, callback: Callable[[], object], topic: str, message: bytes) -> bool:
        """Queue a subscription's callback until the kernel is stopped; return whether queued.

        With subscribers outside the lane, the middleware delivers a copy of every message that the
        kernel reads. These are dropped while the kernel goes on; for others it is stopped once for
        several (:attr:`until_called_s`).

        Args:
            callback: with its message bound.
            topic: its full name and type on the lane.
            message: its bytes.
        """
        if not self.turn.kernel_runs:
            return False
        found, now = self._is_copy(topic, message), time.monotonic_ns()
        if found:
            return True
        due_ns = self._called_ns + CALLS_NS
        if found is not None:
            due_ns = max(due_ns, now + READS_NS)
        if due_ns <= now:
            return False
        self._due_ns = min(self._due_ns, due_ns) if self._deferred else due_ns
        self._deferred.append(_Deferred(topic, message, callback))
        return True

    @property
    def until_called_s(self) -> float:
        """Time left until queued callbacks are due, s."""
        return (self._due_ns - time.monotonic_ns()) / NANOSECONDS

    def drop_copies(self) -> None:
        """Drop queued callbacks of messages that the kernel has read by now."""
        for _ in range(len(self._deferred)):
            # Another thread may run them meanwhile.
            with suppress(IndexError):
                one = self._deferred.popleft()
                if not self._is_copy(one.topic, one.message):
                    self._deferred.append(one)

    def _is_copy(self, topic: str, message: bytes) -> bool | None:
        """Return whether a message was read in this run of the kernel or before; None: by none."""
        wait = None if self.lane is None else self.lane.wait
        took = None if wait is None else wait.took(topic, message)
        before = self._copies.get(topic.split(" ", 1)[0])
        return took or (before.had(message) if took is not None and before is not None else took)

    @property
    def has_deferred(self) -> bool:
        """Whether callbacks are queued for :meth:`taken`."""
        return bool(self._deferred)

    def run_view(self, meet: Meet, publish: Callable[[], None]) -> None:
        """Publish a view; :meth:`meet_failures` handles an error.

        Args:
            meet: handles an error of the actor.
            publish: publishes the view.
        """
        try:
            publish()
        except Exception as error:  # noqa: BLE001 - as in Failures.run
            self.fail_view(meet, error)

    def fail_view(self, meet: Meet, error: Exception) -> None:
        """Have :meth:`meet_failures` handle the error of a view; arguments as there."""
        self._failed.append(partial(meet, "view", error))

    def meet_failures(self) -> None:
        """Handle the errors of views: each resets its actor or deactivates its node."""
        while self._failed:
            with self.taken():
                self._failed.popleft()()

    def join_lane(self, environment: Mapping[str, str]) -> None:
        """Open a lane to other nodes, or set ``refusal`` to the reason why not.

        Args:
            environment: of this process.
        """
        if self.lane is not None or self.refusal:
            return
        try:
            self.lane = Lane.open(environment)
        except LaneError as error:
            self.refusal = str(error)

    def ring(self) -> None:
        """Wake the loop's thread."""
        self.turn.ring()

    def close(self) -> None:
        """Close the lane."""
        if self.lane is not None:
            self.lane.close()
            self.lane = None

    def outlet(
        self, publisher: Publishes, topic: str, stays: bool, kind: str = "", later: bool = False
    ) -> Outlet:
        """Return the outlet that publishes a topic.

        Args:
            publisher: of the middleware.
            topic: its full name.
            stays: whether the middleware keeps messages for late subscribers.
            kind: the messages' type on the lane; empty: they do not use the lane.
            later: whether they may wait until the loop has nothing else to do.
        """
        self._outlets += 1
        lane_topic = f"{topic} {kind}" if kind and not stays else ""
        return Outlet(self, publisher, lane_topic, self._outlets, stays, later)

    def listen(self, topic: str, listener: Listener, kind: str = "") -> Callable[[bytes], bool]:
        """Subscribe ``listener`` to the latest message of each publisher of a topic on the lane.

        Args:
            topic: its full name.
            listener: called with a message and its origin.
            kind: the messages' type on the lane; empty: they do not use the lane.

        Returns:
            A function that returns whether a message of the topic's raw subscription was already
            received over the lane.
        """
        if self.lane is not None and kind:
            self.lane.listen(f"{topic} {kind}", listener)
        return self._detects_copies(topic, kind)

    def listen_to_all(
        self, topic: str, listener: BatchListener, kind: str
    ) -> Callable[[bytes], bool]:
        """Subscribe ``listener`` to all messages of a topic on the lane, in batches.

        Args:
            topic: its full name.
            listener: called with messages and their origins.
            kind: the messages' type.

        Returns:
            As :meth:`listen`.
        """
        if self.lane is not None:
            self.lane.listen_to_all(f"{topic} {kind}", listener)
        return self._detects_copies(topic, kind)

    def _detects_copies(self, topic: str, kind: str) -> Callable[[bytes], bool]:
        copies, lane = self._copies.setdefault(topic, _Copies()), self.lane
        if lane is None or not kind:
            return lambda message: False

        def had(message: bytes) -> bool:
            if copies.had(message):
                return True
            if lane.linked:
                # A publisher that uses both sends over the lane first: it has arrived by now.
                self.collect(whole=True)
                self.deliver()
                return copies.had(message)
            return False

        return had

    def silence(self, topic: str, listener: Listener, kind: str = "") -> None:
        """Unsubscribe a listener, and drop its undelivered messages."""
        if kind and self.lane is not None:
            self.lane.silence(f"{topic} {kind}", listener)
        self._waiting = deque(one for one in self._waiting if one.listener != listener)

    @property
    def is_linked(self) -> bool:
        """Whether another node is connected by the lane."""
        return self.lane is not None and self.lane.linked

    @property
    def has_news(self) -> bool:
        """Whether a kernel should end: for :meth:`.lane.Lane.look`, or for other subscribers."""
        lane = self.lane
        return lane is not None and (lane.has_news or bool(lane.wait and lane.wait.has_news))

    @property
    def has_stepped(self) -> bool:
        """Whether a kernel has just done steps, and is to do the next ones, those due included."""
        lane = self.lane
        return lane is not None and lane.worked and lane.wait is not None and lane.wait.stepped

    @property
    def may_wait(self) -> bool:
        """Whether the calling thread may keep views until the loop has time."""
        return self.turn.is_of_loop and (self.is_linked or self.has_later)

    def publish_later(self, outlet: Outlet, message: bytes) -> None:
        """Keep a message until :meth:`publish_one`; if too many are kept, send the oldest now."""
        if len(self._later) == MOST_LATER:
            self.publish_one()
        self._later.append((outlet, message))

    @property
    def has_later(self) -> bool:
        """Whether messages are kept by :meth:`publish_later`."""
        return bool(self._later)

    @property
    def is_waiting(self) -> bool:
        """Whether messages wait for :meth:`deliver`."""
        return bool(self._waiting)

    def publish_one(self) -> bool:
        """Send the oldest message kept by :meth:`publish_later`; return whether there was one."""
        if not self._later:
            return False
        outlet, message = self._later.popleft()
        outlet.publish_bytes(message)
        return True

    def publish_kept(self) -> None:
        """Send all messages kept by :meth:`publish_later`."""
        while self.publish_one():
            pass

    def collect(self, timeout_s: float = 0.0, whole: bool = False, longest_s: float = 0.0) -> None:
        """Receive messages from the lane, and queue them for :meth:`deliver`.

        Args:
            timeout_s: longest wait for a first message, s.
            longest_s: see :meth:`Lane.collect`.
            whole: whether to receive all messages that have arrived.
        """
        lane = self.lane
        if lane is None:
            return
        self._waiting += lane.collect(timeout_s, whole, longest_s)
        self._note_copied(lane)

    def _note_copied(self, lane: Lane) -> None:
        """Note messages from the lane that the middleware delivers too, to drop the copies."""
        for topic, message in lane.copied:
            self._copies.setdefault(topic.split(" ", 1)[0], _Copies()).note(message)
        lane.copied.clear()

    def deliver(self) -> None:
        """Pass queued messages to their listeners, those queued meanwhile included."""
        if self._delivering:
            return
        self._delivering = True
        try:
            while self._waiting:
                listener, message, origin = self._waiting.popleft()
                listener(message, origin)
        finally:
            self._delivering = False
