# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A node's messages: to nodes of this user on this host over the lane, to others by the middleware.

A serialized message goes over the lane (:mod:`~hapticmech_ros.nodes.lane`) to whoever subscribes to
its topic there, and to the middleware only if somebody else does too. The copies that the
middleware then brings to subscribers on the lane are dropped. Other programs see no difference.
"""

from __future__ import annotations

import ctypes
import threading
import time
from collections import deque
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from functools import cache, partial
from typing import Any, Protocol

import numpy as np

from hapticmech_ros.nodes.lane import MOST_BYTES, Arrived, Lane, LaneError
from hapticmech_ros.nodes.messages import check_finite
from hapticmech_ros.nodes.sources import BatchListener, Listener
from hapticmech_ros.nodes.turn import FOR_EVER
from hapticmech_ros.numerics import Array
from hapticmech_ros.numerics.times import NANOSECONDS

# How many messages may be on their way through the middleware to those who had them already, and
# for how long: what comes later is somebody else's. A recorder without a processor may look at what
# the middleware has brought after seconds only.
MOST_UNDERWAY = 10_000
UNDERWAY_NS = 10 * NANOSECONDS
# How long an answer holds to the question of who listens: asked each time it would cost as much as
# a message. Somebody new outside hears a topic at most so much later.
CENSUS_NS = 20_000_000
# After a change on the lane the middleware carries messages too for so long: it may know of a
# listener that comes or goes only then.
SETTLES_NS = NANOSECONDS // 4
# Callbacks of subscriptions stop a kernel so often, ns.
CALLS_NS = 8_000_000
# Of messages that wait for the loop to have time.
MOST_LATER = 200


class Publishes(Protocol):
    """What is needed of an rclpy publisher."""

    def publish(self, message: Any) -> None:
        """Send a message, or its bytes."""

    def get_subscription_count(self) -> int:
        """Return how many subscriptions it has met, those of this process included."""


class Meets(Protocol):
    """What is needed of an actor's failures."""

    def met(self, what: str, error: Exception) -> None:
        """Say what went wrong, and begin anew, or give up."""


# As of a node with one thread.
_ALWAYS = np.array([FOR_EVER])


@cache
def _rcl_publishes() -> int:
    """Return the address of ``rcl_publish_serialized_message``, which rclpy calls for bytes."""
    from rclpy.impl.implementation_singleton import rclpy_implementation

    library = ctypes.CDLL(rclpy_implementation.__file__)
    found = ctypes.cast(library.rcl_publish_serialized_message, ctypes.c_void_p).value
    return found or 0


class _Copies:
    """Messages of a topic that the middleware brings too."""

    __slots__ = ("underway",)

    def __init__(self) -> None:
        # By hash: so many messages of ten seconds would take as many megabytes.
        self.underway: dict[int, int] = {}

    def note(self, message: bytes) -> None:
        """Note that the middleware will bring what was handed over."""
        underway = self.underway
        underway[hash(message)] = time.monotonic_ns()
        if len(underway) > MOST_UNDERWAY:
            del underway[next(iter(underway))]

    def had(self, message: bytes) -> bool:
        """Return whether a message that the middleware brings was handed over before."""
        noted = self.underway.get(hash(message))
        return noted is not None and time.monotonic_ns() - noted < UNDERWAY_NS


class Outlet:
    """A publisher that knows who listens.

    Args:
        exchange: of the node.
        publisher: to those outside.
        topic: its full name and type on the lane; empty: it does not go there.
        number: of this outlet of the node.
        stays: whether a message is kept for those who come later, and so must always be sent.
        later: whether a serialized message may wait until the loop has nothing else to do.

    Attributes:
        topic, number: as given.
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
        self._published = 0
        self._readers = 0
        self._census_ns = -CENSUS_NS
        self._on_lane = 0
        self._settled_ns = 0
        # What people see is published by several threads.
        self._lock = threading.Lock()

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
        if type(message) is not bytes:
            if self.wanted:
                check_finite(message)
                self.publish_outside(message)
        elif self.later and self._exchange.may_wait:
            self._exchange.publish_later(self, message)
        else:
            self.publish_bytes(message)

    def publish_bytes(self, message: bytes) -> None:
        """Send a serialized message by all ways on which somebody listens."""
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
        # First, so that a subscriber by both ways knows the copy when it comes.
        lane.send(self.topic, self.number, self._published + both, message, both)
        if both:
            self.publish_outside(message)

    @property
    def published(self) -> int:
        """How many messages have gone through the middleware."""
        return self._published

    def note_published(self, number: int) -> None:
        """Note how many messages have gone through the middleware, some by :attr:`rcl`."""
        self._published = number

    @property
    def rcl(self) -> tuple[int, int]:
        """Addresses of what publishes bytes in rcl, and of the publisher there; zeros: none."""
        handle = getattr(self.publisher, "handle", None)
        return (0, 0) if handle is None else (_rcl_publishes(), handle.pointer)

    @property
    def way(self) -> bool | None:
        """Whether a message would go to the middleware beside the lane.

        None if it would not go to the lane.
        """
        lane, now = self._exchange.lane, time.monotonic_ns()
        readers = lane.readers(self.topic) if lane and self.topic else 0
        if not readers or readers != self._on_lane or self._stays:
            return None
        return now < self._settled_ns or self._count(now) > readers

    def ways(self) -> str:
        """Return by which ways a message goes now, in words."""
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
        self._published += 1
        self.publisher.publish(message)

    def _count(self, now: int) -> int:
        """Return how many subscriptions there are, those on the lane included."""
        if now - self._census_ns >= CENSUS_NS:
            self._census_ns = now
            self._readers = self.publisher.get_subscription_count()
        return self._readers


class Exchange:
    """A node's messages by the lane and by the middleware.

    What comes over the lane is delivered by :meth:`deliver`, in the order of arrival, and never
    from within another message's callback.

    Attributes:
        lane: to other nodes of this host; None: all goes through the middleware.
        refusal: why there is no lane though one was asked for.
    """

    def __init__(self) -> None:
        self.lane: Lane | None = None
        self.refusal = ""
        self._copies: dict[str, _Copies] = {}
        self._failed: deque[Callable[[], None]] = deque()
        self._deferred: deque[Callable[[], object]] = deque()
        self._called_ns = 0
        self._waiting: deque[Arrived] = deque()
        self._later: deque[tuple[Outlet, bytes]] = deque()
        self._delivering = False
        self._outlets = 0

    @property
    def listened(self) -> Array:
        """(1,) Until when the middleware was last listened to, ns; see :class:`.turn.Turn`."""
        return _ALWAYS if self.lane is None else self.lane.turn.listened

    @property
    def is_deaf(self) -> bool:
        """Whether it has not been listened to for too long."""
        return self.lane is not None and self.lane.turn.is_deaf

    @property
    def settled(self) -> bool:
        """Whether the node knows what its kernel has done."""
        wait = None if self.lane is None else self.lane.wait
        return wait is None or wait.settled

    def settle(self) -> None:
        """Have it know that, before a callback of its runs."""
        if self.lane is not None and self.lane.wait is not None:
            self.lane.wait.settle()
            self._note_copied(self.lane)

    @contextmanager
    def taken(self, rings: bool = False) -> Iterator[None]:
        """Return a context for a callback: no kernel runs, and the node knows what one has done.

        Args:
            rings: whether the loop is to look at its deadlines afterwards.
        """
        if self.lane is None:
            yield
            return
        turn = self.lane.turn
        with turn.taken():
            self.settle()
            if turn.is_of_loop:
                yield
                return
            # The loop may wait for long; and what is published next is newer.
            self.publish_kept()
            while self._deferred:
                self._deferred.popleft()()
            yield
            self._called_ns = time.monotonic_ns()
            if rings:
                turn.ring()

    def defer(self, callback: Callable[[], object]) -> bool:
        """Let a subscription's callback wait until a kernel is stopped anyway; return whether.

        Where somebody outside hears the nodes too, the middleware brings copies of all that the
        kernel reads: it is stopped for those of some milliseconds at once (:attr:`until_called_s`).

        Args:
            callback: with its message.
        """
        turn = None if self.lane is None else self.lane.turn
        if turn is None or not turn.kernel_runs or self.until_called_s <= 0.0:
            return False
        self._deferred.append(callback)
        return True

    @property
    def until_called_s(self) -> float:
        """How long callbacks may wait for others, s."""
        return (self._called_ns + CALLS_NS - time.monotonic_ns()) / NANOSECONDS

    @property
    def has_deferred(self) -> bool:
        """Whether callbacks wait for :meth:`taken`."""
        return bool(self._deferred)

    def run_view(self, failures: Meets, publish: Callable[[], None]) -> None:
        """Publish what people see; what fails is met by :meth:`meet_failures`.

        Args:
            failures: of the actor.
            publish: publishes it.
        """
        try:
            publish()
        except Exception as error:  # noqa: BLE001 - as in Failures.run
            self._failed.append(partial(failures.met, "view", error))

    def meet_failures(self) -> None:
        """Let an actor begin anew of which what people see could not be published."""
        while self._failed:
            with self.taken():
                self._failed.popleft()()

    def publish_views(self) -> None:
        """Publish what another thread is to publish, or wait for it: see :class:`.turn.Turn`."""
        if self.lane is not None:
            self.lane.turn.publish_views()

    def join_lane(self, environment: Mapping[str, str]) -> None:
        """Have a lane to other processes from now on, or say in ``refusal`` why not.

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
        """Have the loop's thread stop waiting."""
        if self.lane is not None:
            self.lane.turn.ring()

    def close(self) -> None:
        """Leave the lane."""
        if self.lane is not None:
            self.lane.close()
            self.lane = None

    def outlet(
        self, publisher: Publishes, topic: str, stays: bool, kind: str = "", later: bool = False
    ) -> Outlet:
        """Return what to publish a topic through.

        Args:
            publisher: to those outside.
            topic: its full name.
            stays: whether messages are kept for those who come later.
            kind: the messages' type, if they may go over the lane.
            later: whether they may wait until the loop has nothing else to do.
        """
        self._outlets += 1
        lane_topic = f"{topic} {kind}" if kind and not stays else ""
        return Outlet(self, publisher, lane_topic, self._outlets, stays, later)

    def listen(self, topic: str, listener: Listener, kind: str = "") -> Callable[[bytes], bool]:
        """Hand the latest message of each publisher of a topic on the lane to ``listener``.

        Args:
            topic: its full name.
            listener: called with messages and their origin.
            kind: the messages' type; empty: they do not come over the lane.

        Returns:
            A function that tells whether a message of the topic's raw subscription was handed over
            already.
        """
        if self.lane is not None and kind:
            self.lane.listen(f"{topic} {kind}", listener)
        return self._detects_copies(topic, kind)

    def listen_to_all(
        self, topic: str, listener: BatchListener, kind: str
    ) -> Callable[[bytes], bool]:
        """Hand all messages of other processes on a topic to ``listener``, in batches.

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
                # Whoever sends both ways sends over the lane first: now it has come.
                self.collect(whole=True)
                self.deliver()
                return copies.had(message)
            return False

        return had

    def silence(self, topic: str, listener: Listener, kind: str = "") -> None:
        """Hand over no more; what waits for the listener is dropped."""
        if kind and self.lane is not None:
            self.lane.silence(f"{topic} {kind}", listener)
        self._waiting = deque(one for one in self._waiting if one.listener != listener)

    @property
    def is_linked(self) -> bool:
        """Whether another node is on the lane."""
        return self.lane is not None and self.lane.linked

    @property
    def has_news(self) -> bool:
        """Whether the loop's thread is to look after the lane; see :meth:`.lane.Lane.look`."""
        return self.lane is not None and self.lane.has_news

    @property
    def may_wait(self) -> bool:
        """Whether what people see may wait until the thread that asks has time."""
        is_of_loop = self.lane is None or self.lane.turn.is_of_loop
        return is_of_loop and (self.is_linked or self.has_later)

    def publish_later(self, outlet: Outlet, message: bytes) -> None:
        """Keep a message until the loop has time for it: see :meth:`publish_one`."""
        if len(self._later) == MOST_LATER:
            self.publish_one()
        self._later.append((outlet, message))

    @property
    def has_later(self) -> bool:
        """Whether :meth:`publish_later` has kept anything."""
        return bool(self._later)

    @property
    def is_waiting(self) -> bool:
        """Whether there is anything to deliver."""
        return bool(self._waiting)

    def publish_one(self) -> bool:
        """Send the oldest of what :meth:`publish_later` keeps; return whether there was one."""
        if not self._later:
            return False
        outlet, message = self._later.popleft()
        outlet.publish_bytes(message)
        return True

    def publish_kept(self) -> None:
        """Send all that :meth:`publish_later` keeps."""
        while self.publish_one():
            pass

    def collect(self, timeout_s: float = 0.0, whole: bool = False, longest_s: float = 0.0) -> None:
        """Let what has come over the lane wait for its listeners.

        Args:
            timeout_s: how long to wait for anything to come.
            longest_s: see :meth:`Lane.collect`.
            whole: whether all that has come is wanted now.
        """
        lane = self.lane
        if lane is None:
            return
        self._waiting += lane.collect(timeout_s, whole, longest_s)
        self._note_copied(lane)

    def _note_copied(self, lane: Lane) -> None:
        """Note what came over the lane and the middleware brings too, to know it then."""
        for topic, message in lane.copied:
            self._copies.setdefault(topic.split(" ", 1)[0], _Copies()).note(message)
        lane.copied.clear()

    def deliver(self) -> None:
        """Hand over what waits, and what is published meanwhile."""
        if self._delivering:
            return
        self._delivering = True
        try:
            while self._waiting:
                listener, message, origin = self._waiting.popleft()
                listener(message, origin)
        finally:
            self._delivering = False
