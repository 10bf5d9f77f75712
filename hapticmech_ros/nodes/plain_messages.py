# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Lets a node's kernel handle plain messages, without Python, while its process waits.

A message is plain if it comes over the lane from the only publisher of its topic so far, and keeps
all rules. The kernel publishes to subscribers on the lane, and through rcl to others, as rclpy
would. Python handles all other messages as it would without a kernel: see :mod:`.lane_kernels`.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from hapticmech_ros.compilation import arrays_of
from hapticmech_ros.nodes import lane_kernels as kernels
from hapticmech_ros.nodes.exchange import Outlet
from hapticmech_ros.nodes.lane import MESSAGE, Lane, Outgoing
from hapticmech_ros.nodes.node_time import STEP_NS
from hapticmech_ros.nodes.sources import OUTLETS, Origin, Sources
from hapticmech_ros.nodes.turn import Turn
from hapticmech_ros.numerics import Array
from hapticmech_ros.numerics.times import nanoseconds
from hapticmech_ros.wire.bounds import SixBounds
from hapticmech_ros.wire.wrench import encode_wrench

# Most messages of one run of a kernel; most of them that the middleware delivers too, of a topic;
# and most processes on the lane that subscribe to a topic.
MOST_READ, MOST_COPIED, MOST_HEARERS = 16_384, 1024, 62
# After a pause a kernel answers each message of a backlog, within microseconds. Python handles
# messages that were sent longer ago than this, ns: it skips to the newest.
OLD_NS = 8_000_000
# Least time between views, ns, for as long after a late step or a pause.
GIVE_WAY_NS = 50_000_000
# Shortest period of views for people, s.
FOR_PEOPLE_S = 0.006
# Where in the bytes of a WrenchStamped its stamp, the name of its frame, and its wrench begin.
_STAMP_AT, _FRAME_AT, _WRENCH_AT = 4, 12, 28
# Clock readings no further apart than this, ns, count as simultaneous.
_CLOSE_NS = 50_000


def frame_of(prefix: bytes, size: int) -> tuple[Array, Array]:
    """Return the frame (n,) of a lane message with its prefix in place, and a view of its data.

    Args:
        prefix: its bytes before the data.
        size: number of its data.
    """
    before = kernels.BEGINS_AT + kernels.HEADER_BYTES + len(prefix)
    words = np.zeros(before // 8 + size, dtype=np.int64)
    words.view(np.uint8)[before - len(prefix) : before] = bytearray(prefix)
    return words, words[before // 8 :].view(np.float64)


def words_of(data: bytes) -> Array:
    """Return bytes as words (n,), padded with zeros."""
    return np.frombuffer(data.ljust(-(-len(data) // 8) * 8, b"\0"), np.int64).copy()


NO_WORDS = np.zeros(0, dtype=np.int64)


class Received(NamedTuple):
    """A topic that is read.

    Attributes:
        topic: its full name and type on the lane.
        sources: its publishers.
        prefix: bytes of a message before its numbers.
        most: (n,) largest magnitude of each number.
        alike: how many bytes of ``prefix`` all messages share; None: all.
        between: (words,) see :class:`.lane_kernels.SubscribedTopic`.
        beside: whether the kernel reads it only if it shares the previous topic's connection.
        awaited: whether a message wakes the kernel, which else reads it when it acts.
        may_lack: whether the kernel also runs while nobody has published it for a while.
    """

    topic: str
    sources: Sources
    prefix: bytes
    most: Array
    alike: int | None = None
    between: Array = NO_WORDS
    beside: bool = False
    awaited: bool = True
    may_lack: bool = False

    def made(self) -> kernels.SubscribedTopic:
        """Return buffers for its messages."""
        alike, (frame, values) = self.prefix[: self.alike], frame_of(self.prefix, self.most.size)
        parts = {
            "reading": np.zeros(kernels.Reading.layout.size),
            "prefix": words_of(alike),
            "between": self.between,
            "frame": frame,
            "copies": np.zeros((MOST_COPIED, frame.size)),
            "values": values,
            "most": self.most,
        }
        topic = kernels.SubscribedTopic(*arrays_of(kernels.SubscribedTopic, {}, parts))
        topic.reading.data = kernels.HEADER_BYTES + len(alike)
        topic.reading.length = kernels.HEADER_BYTES + len(self.prefix) + 8 * values.size
        return topic


def stacked(topics: Sequence[kernels.SubscribedTopic]) -> tuple[Array, Array]:
    """Move topics of one type into two arrays, for a kernel that reads any number of them.

    Args:
        topics: with messages of the same length; changed to views of the arrays.

    Returns:
        (topics, integers) and (topics, numbers).
    """
    if not topics:
        return np.zeros((0, 0), dtype=np.int64), np.zeros((0, 0))
    numbers = np.array([one.numbers for one in topics])
    data = np.array([one.data for one in topics])
    for one, *views in zip(topics, numbers, data, strict=True):
        one.numbers, one.data = views
    return numbers, data


class Publication(NamedTuple):
    """A topic that is published.

    Attributes:
        outlet: its publisher.
        prefix: bytes of a message before its numbers.
        most: (n,) largest magnitude of each number.
    """

    outlet: Outlet
    prefix: bytes
    most: Array

    def made(self) -> kernels.PublishedTopic:
        """Return a buffer for its message."""
        frame, values = frame_of(self.prefix, self.most.size)
        parts = {
            "sending": np.zeros(kernels.Sending.layout.size),
            "frame": frame,
            "targets": np.zeros(2 * MOST_HEARERS),
            "values": values,
            "most": self.most,
        }
        topic = kernels.PublishedTopic(*arrays_of(kernels.PublishedTopic, {}, parts))
        topic.sending.head = MESSAGE | self.outlet.number << 32
        topic.sending.length = kernels.HEADER_BYTES + len(self.prefix) + 8 * values.size
        return topic


def _head(origin: Origin, code: int) -> int:
    """Return the first header word of a publisher's messages; ``code`` is their topic's number."""
    return MESSAGE | code << 16 | (origin.via & OUTLETS) << 32


def _continued(origin: Origin, row: kernels.Reading) -> Origin:
    """Return the origin of a topic's last message, as the kernel left it."""
    return origin._replace(number=row.number, sent=row.counted, sent_ns=row.sent_ns)


class PlainCommand:
    """The bytes of a WrenchStamped in ``world``, of which only stamp and wrench vary.

    Args:
        bounds: of the wrench.

    Attributes:
        prefix: bytes before the wrench.
        between: (2,) words with the bytes between stamp and wrench.
        most: (6,) largest magnitudes, N and N m.
    """

    def __init__(self, bounds: SixBounds) -> None:
        whole = encode_wrench(np.zeros(6), 0)
        self.prefix = whole[:_WRENCH_AT]
        self.between = words_of(whole[_FRAME_AT:_WRENCH_AT])
        self.most = np.array([bounds.first] * 3 + [bounds.last] * 3)

    def received(self, topic: str, sources: Sources) -> Received:
        """Return a topic on which such commands are read."""
        return Received(
            topic, sources, self.prefix, self.most, _STAMP_AT, self.between, awaited=False
        )


class PlainMessages:
    """Lets a kernel handle an actor's plain messages; each kind of actor has a subclass.

    Args:
        actor: the actor.
        received: topics that are read.
        published: topics that are sent.
        link: state shared with the kernel.
        passed_over: topics that the kernel discards where they share the first one's connection,
            by their names on the lane, and their publishers.

    Attributes:
        inputs, outputs: buffers of each topic that is read, and of each that is sent.
        passed: (k, 9) a :class:`~.lane_kernels.Reading` of each topic that is passed over.
        polled, ages: arguments of the kernel.
    """

    def __init__(
        self,
        actor: Any,
        received: Sequence[Received],
        published: Sequence[Publication],
        link: kernels.Link,
        passed_over: Sequence[tuple[str, Sources]] = (),
    ) -> None:
        self._actor, self._received, self._published = actor, received, published
        # Not None while the actor lacks some of the kernel's work.
        self._lane: Lane | None = None
        self._code = kernels.TIME_IS_UP
        self._late_ns = self._viewed_ns = 0
        self._passed_over = passed_over
        # Messages that do not wake the kernel are read within a period.
        link.step, link.behind = STEP_NS, OLD_NS + nanoseconds(actor.period_s)
        self._shared = link
        self.inputs = [one.made() for one in received]
        self.outputs = [one.made() for one in published]
        reads = kernels.Reading.layout.size
        self.passed = np.zeros((len(passed_over), reads), dtype=np.int64)
        self._passing = [kernels.Reading(row) for row in self.passed]
        self.ages = np.zeros(MOST_READ, dtype=np.int64)
        self.polled = np.zeros(0, dtype=np.int64)
        # Of each topic: its number; up to which of the kernel's messages `took` has found copies;
        # and of which before that it has not.
        self._numbers = {one.topic: i for i, one in enumerate(received)}
        self._found = [0] * len(received)
        self._missing: list[list[int]] = [[] for _ in received]
        # Two threads change these: one may look for a copy as the kernel's run ends.
        self._finding = threading.Lock()
        self._waited: list[int] = []
        self._others: list[int] = []
        self._hearers: list[list[tuple[Outgoing, int]]] = []

    def ready(self) -> bool:
        """Give the kernel the actor's state; return whether the kernel may run now."""
        raise NotImplementedError

    def kernel(self) -> Callable[[], int]:
        """Return the kernel with its arguments; a call returns why the kernel has returned."""
        raise NotImplementedError

    def view(self) -> Callable[[], None]:
        """Return a function that publishes a view of the kernel's last message.

        It runs beside the kernel: it must use nothing that the kernel works in, models included.
        """
        raise NotImplementedError

    def did(self, code: int, reads: int) -> None:
        """Update the actor with the kernel's work.

        Args:
            code: why it returned.
            reads: how many messages it read.
        """
        raise NotImplementedError

    def origin(self, at: int) -> Origin:
        """Return the origin of the last message that the kernel read of a topic.

        Args:
            at: index of the topic in ``inputs``.
        """
        return _continued(self._received[at].sources.latest, self.inputs[at].reading)

    def prepare(self, lane: Lane, waited: list[int], until_ns: int) -> bool:
        """Fill the state shared with the kernel; return whether the kernel may run.

        Args:
            lane: of the process.
            waited: file descriptors of its connections.
            until_ns: until when to wait, ns of the monotonic clock.
        """
        link = self._shared
        before, now, after = time.monotonic_ns(), self._actor.now_ns(), time.monotonic_ns()
        if after - before > _CLOSE_NS or not self._actor.node.active:
            # Inactive, or interrupted: the clocks' difference would be wrong by as much.
            return False
        link.ahead = now - (before + after) // 2
        if not (self._prepare_to_send(lane) and self._prepare_to_read(lane, waited)):
            return False
        link.until = until_ns
        link.oldest = self._actor.age_limit_ns
        link.reads = link.pauses.count = link.asked = 0
        return self.ready()

    def _prepare_to_send(self, lane: Lane) -> bool:
        """Find subscribers; return whether the kernel reaches all, and not too many on the lane."""
        self._hearers = []
        for one, topic in zip(self._published, self.outputs, strict=True):
            outlet, row = one.outlet, topic.sending
            way = outlet.way
            hearers = [] if way is None else lane.plain_hearers(outlet.topic)
            reached = way is not None and bool(hearers) == (lane.readers(outlet.topic) > 0)
            if not reached or len(hearers) > MOST_HEARERS:
                return False
            row.both = bool(way)
            if way:
                row.publishes, row.publisher = outlet.rcl
            numbers = [number for to, code in hearers for number in (to.connection.fileno(), code)]
            self._hearers.append(hearers)
            topic.targets[: len(numbers)], row.hearers = numbers, len(hearers)
            row.number = outlet.published
            row.sent = lane.sent[outlet.number]
            row.unsent = row.left = 0
        return True

    def _prepare_to_read(self, lane: Lane, waited: list[int]) -> bool:
        """Find publishers; return whether each topic has one, over a connection of its own.

        Topics that are read ``beside`` another, or passed over, need not.
        """
        first: list[int] = []
        now = self._actor.now_ns()
        for one, topic in zip(self._received, self.inputs, strict=True):
            row = topic.reading
            with self._finding:
                row.copied, at = 0, self._numbers[one.topic]
                self._found[at], self._missing[at] = 0, []
            connection = self._connection(lane, one.topic, one.sources, row)
            if one.beside and connection != first[-1]:
                row.head = 0
            elif not one.beside and not (
                connection < 0 and one.may_lack and one.sources.silent(now)
            ):
                first.append(connection)
        for (name, sources), row in zip(self._passed_over, self._passing, strict=True):
            if self._connection(lane, name, sources, row) != first[0]:
                row.head = 0
        if -1 in first:
            return False
        topics = zip(self._received, self.inputs, strict=True)
        awaited = [topic for one, topic in topics if one.awaited and not one.beside]
        polled = [topic.reading.connection for topic in awaited]
        self._waited, self._others = waited, [one for one in waited if one not in first]
        polled += self._others
        self.polled = np.array(polled, dtype=np.int64) | kernels.WAITS_TO_READ
        return len(set(first)) == len(first)

    @staticmethod
    def _connection(lane: Lane, topic: str, sources: Sources, row: kernels.Reading) -> int:
        """Return the file descriptor over which a topic's only publisher sends; -1: none.

        Args:
            lane: of the process.
            topic: its full name and type on the lane.
            sources: its publishers.
            row: to fill.
        """
        origin = sources.only
        speaker = origin and lane.speaker(topic, origin.via)
        row.head, row.read, row.connection = 0, 0, -1
        if origin is None or speaker is None:
            return -1
        row.head, row.number = _head(origin, speaker[1]), origin.number
        row.connection = speaker[0]
        return speaker[0]

    def __call__(self, lane: Lane) -> Sequence[int]:
        """Run the kernel until there is work for Python, once :meth:`prepare` allows it.

        Args:
            lane: of the process.

        Returns:
            The connections that Python is to read. If one without plain messages needs Python,
            those with plain messages are left out, so that the kernel can answer each of these.
        """
        link, self._lane = self._shared, lane
        kernel = self.kernel()
        with lane.turn.given_to_kernel():
            while True:
                self._code = kernel()
                if not (self._code == kernels.TO_LOOK_AT and self._show(lane.turn)):
                    break
                link.until_view = self._actor.view_every
                if any(one.sending.left or one.sending.unsent for one in self.outputs):
                    self._code = kernels.TO_SEND
                    break
        code = self._code
        self.settle()
        if code == kernels.TO_LOOK_AT:
            self._view()()
            self._actor.node.exchange.meet_failures()
        if code != kernels.TO_READ:
            return []
        ended = kernels.has_ended(self.polled)
        return self._others if link.asked and not ended else self._waited

    def _show(self, turn: Turn) -> bool:
        """Have another thread publish a view; return whether the kernel may go on at once.

        For a while after a pause or a late step, some views are left out. More frequent ones than
        people need are CRTK's samples, for a controller: the loop's thread publishes each.
        """
        if self._actor.view_every * self._actor.period_s < FOR_PEOPLE_S:
            return False
        now, pauses = time.monotonic_ns(), self._shared.pauses.each()
        late_ns = pauses[-1][0] if pauses else self._late_ns
        give_way = now - late_ns < GIVE_WAY_NS and now - self._viewed_ns < GIVE_WAY_NS
        if turn.is_shared and give_way:
            return True
        self._viewed_ns = now
        return turn.view(self._view())

    def _view(self) -> Callable[[], None]:
        exchange, meet = self._actor.node.exchange, self._actor.failures.met
        try:
            return partial(exchange.run_view, meet, self.view())
        except Exception as error:  # noqa: BLE001 - as in run_view
            return partial(exchange.fail_view, meet, error)

    @property
    def has_news(self) -> bool:
        """Whether the running kernel's messages should go other ways; any thread may ask."""
        topics = zip(self._published, self.outputs, strict=True)
        return self._lane is not None and any(
            bool(one.outlet.way) != bool(topic.sending.both) for one, topic in topics
        )

    def took(self, topic: str, message: bytes) -> bool | None:
        """Return whether the kernel has read a message of which the middleware brings a copy.

        Any thread may ask while the kernel runs. Copies come in the order of the messages.

        Args:
            topic: its full name and type on the lane.
            message: its bytes.

        Returns:
            None if the kernel reads no such topic.
        """
        at = self._numbers.get(topic)
        if at is None:
            return None
        read, copies = self.inputs[at].reading, self.inputs[at].copies
        with self._finding:
            for row in range(self._found[at], read.copied):
                if self._bytes(copies[row], read.length) == message:
                    self._missing[at] += range(self._found[at], row)
                    self._found[at] = row + 1
                    return True
        return False

    @property
    def stepped(self) -> bool:
        """Whether the kernel's last run did steps at deadlines, and may do the next.

        It then makes up for those missed since; a step by Python would take longer.
        """
        link = self._shared
        is_pythons = self._code in (kernels.TO_ACT, kernels.TO_SAY)
        return isinstance(link, kernels.DeadlineLink) and link.done > 0 and not is_pythons

    @property
    def settled(self) -> bool:
        """Whether the actor is up to date with the kernel's work."""
        return self._lane is None

    def settle(self) -> None:
        """Update the actor, the topics' sources and the lane with the kernel's work, once."""
        lane, link, self._lane = self._lane, self._shared, None
        if lane is None:
            return
        for one, sent, hearers in zip(self._published, self.outputs, self._hearers, strict=True):
            self._send_on(lane, one.outlet, sent, hearers)
        for at, (received, topic) in enumerate(zip(self._received, self.inputs, strict=True)):
            row = topic.reading
            if row.read:
                received.sources.received(self.origin(at), row.read)
            with self._finding:
                numbers = [*self._missing[at], *range(self._found[at], row.copied)]
            for number in numbers:
                copy = self._bytes(topic.copies[number], row.length)
                lane.copied.append((received.topic, copy))
        for (_, sources), row in zip(self._passed_over, self._passing, strict=True):
            if row.read:
                sources.received(_continued(sources.latest, row), row.read)
        reads = link.reads
        self._actor.ages.extend(self.ages[:reads])
        self.did(self._code, reads)
        for end_ns, length_ns in link.pauses.each():
            self._actor.node.pauses.paused(end_ns, length_ns)
            self._late_ns = end_ns
        if self._code == kernels.TO_ACT:
            self._late_ns = time.monotonic_ns()

    def _send_on(
        self,
        lane: Lane,
        outlet: Outlet,
        topic: kernels.PublishedTopic,
        hearers: list[tuple[Outgoing, int]],
    ) -> None:
        """Note what the kernel sent; send the last message to subscribers that it did not reach.

        Args:
            lane: of the process.
            outlet: publisher of the topic.
            topic: as the kernel has left it.
            hearers: processes on the lane that subscribe to it.
        """
        row = topic.sending
        number, sent, left = outlet.number, row.sent, bool(row.left)
        lane.sent[number] = sent
        outlet.published = row.number - left
        if not (left or row.unsent):
            return
        message = self._bytes(topic.frame, row.length)
        to = [who for i, who in enumerate(hearers) if row.unsent >> i & 1]
        if to:
            both = bool(row.both)
            lane.send_to(to, number, row.number, sent, message, both)
        if left:
            self._actor.failures.run("publish", outlet.publish_outside, message)

    @staticmethod
    def _bytes(frame: Array, length: int) -> bytes:
        """Return the message in a frame; ``length`` includes the lane's header, bytes."""
        begin = kernels.BEGINS_AT + kernels.HEADER_BYTES
        return frame.tobytes()[begin : kernels.BEGINS_AT + length]
