# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""One topic that is being recorded: its subscription, its messages, and its losses.

Also its quality of service, as requested from publishers, and as offered by a player.

Between the thread that receives messages and the disk are a queue, and a thread that writes. A
stalled disk then delays no subscription. Queued messages are on disk within half a second.
"""

from __future__ import annotations

import queue
import threading
import time
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

from rclpy.duration import Duration, Infinite
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy
from rosbags.interfaces import (
    Qos,
    QosDurability,
    QosHistory,
    QosLiveliness,
    QosReliability,
    QosTime,
)

from hapticmech_ros.bag.metadata import INFINITE
from hapticmech_ros.bag.storage import Messages
from hapticmech_ros.bag.writer import BagWriter
from hapticmech_ros.errors import BagError
from hapticmech_ros.nodes.exchange import Exchange
from hapticmech_ros.nodes.messages import message_class
from hapticmech_ros.nodes.sources import Batch, Info, Origin, WithInfo
from hapticmech_ros.numerics.times import NANOSECONDS

FLUSH_PERIOD_S = 0.4
# Period at which the writing thread takes the queue, s: by one message it would wake up for each.
WRITE_PERIOD_S = 0.05
# Longest queue for a disk; further messages are dropped, and counted.
LONGEST_QUEUE_BYTES = 512 << 20


class BagSpool:
    """Writes messages to a bag from a separate thread.

    Attributes:
        dropped: messages that found the queue full, by topic.
        failure: why writing has ended before its time; the rest is dropped.
    """

    def __init__(self, writer: BagWriter) -> None:
        self._writer = writer
        # What is to be written, and its size in bytes.
        self._queue: queue.SimpleQueue[tuple[Callable[[], None], int] | None] = queue.SimpleQueue()
        self._put_bytes = self._written_bytes = 0
        self.dropped: dict[str, int] = {}
        self._lost: dict[str, int | None] = {}
        self.failure: BagError | None = None
        self._thread = threading.Thread(target=self._work, name="bag", daemon=True)
        self._thread.start()

    def add_topic(self, name: str, msgtype: str, offered: Sequence[Qos]) -> None:
        """Queue the announcement of a topic, before its first message is put.

        It takes milliseconds, in which subscriptions would lose messages; an error of the writer
        ends writing, as a full disk does.
        """
        announce = partial(self._writer.add_topic, name, msgtype, offered=tuple(offered))
        self._queue.put((announce, 0))

    def put(self, name: str, messages: Messages) -> None:
        """Queue messages of a topic."""
        if self.failure or self._put_bytes - self._written_bytes > LONGEST_QUEUE_BYTES:
            self.dropped[name] = self.dropped.get(name, 0) + len(messages)
            return
        size = sum(len(data) for _, data in messages)
        self._put_bytes += size
        self._queue.put((partial(self._writer.write_many, name, messages), size))

    def note_lost(self, name: str, lost: int | None) -> None:
        """Note how many messages of a topic were lost in transit; None: not known."""
        self._lost[name] = lost

    def close(self) -> None:
        """Write the queue, and finish the bag, with its counts of lost or dropped messages.

        Raises:
            BagError: storage full.
        """
        self._queue.put(None)
        self._thread.join()
        for name, lost in self._lost.items():
            if lost is not None:
                self._lost[name] = lost + self.dropped.get(name, 0)
        self._writer.close(self._lost)
        if self.failure:
            raise self.failure

    def _work(self) -> None:
        flushed = time.monotonic()
        while True:
            try:
                item = self._queue.get(timeout=FLUSH_PERIOD_S)
            except queue.Empty:
                item = (lambda: None, 0)
            if item is None:
                return
            (write, size), begun = item, time.monotonic()
            try:
                if not self.failure:
                    write()
                if begun - flushed >= FLUSH_PERIOD_S and not self.failure:
                    flushed = begun
                    self._writer.flush()
            except BagError as error:
                self.failure = error
            self._written_bytes += size
            if self._queue.empty():
                time.sleep(WRITE_PERIOD_S)


# A bag may be busy for a while: at 2 kHz this is half a second of one topic.
RECORDED_DEPTH = 1000
# History of a player's publisher: it holds a burst after a stall.
PLAYED_DEPTH = 1000
# Of a latched one, if not in the bag: a late subscriber gets no more than this.
LATCHED_DEPTH = 10


def as_recorded(profile: QoSProfile) -> Qos:
    """Return a publisher's profile as it goes into a bag; discovery knows no history with DDS."""
    return Qos(
        history=QosHistory(int(profile.history)),
        depth=int(profile.depth),
        reliability=QosReliability(int(profile.reliability)),
        durability=QosDurability(int(profile.durability)),
        deadline=_time(profile.deadline),
        lifespan=_time(profile.lifespan),
        liveliness=QosLiveliness(int(profile.liveliness)),
        liveliness_lease_duration=_time(profile.liveliness_lease_duration),
        avoid_ros_namespace_conventions=bool(profile.avoid_ros_namespace_conventions),
    )


def adapted_request(offered: Sequence[QoSProfile]) -> QoSProfile:
    """Return the strongest QoS of a subscriber that is compatible with every publisher.

    Reliable if all are, and latched messages if all keep them; deadlines and the like are not
    asked for.
    """
    reliable = all(o.reliability == ReliabilityPolicy.RELIABLE for o in offered)
    latched = all(o.durability == DurabilityPolicy.TRANSIENT_LOCAL for o in offered)
    return _profile(RECORDED_DEPTH, reliable, latched and bool(offered))


def adapted_offer(recorded: Sequence[Qos]) -> QoSProfile:
    """Return an offer that every subscriber takes which one of the recorded publishers suited.

    Without recorded profiles it is reliable and volatile.
    """
    reliable = QosReliability.BEST_EFFORT not in {r.reliability for r in recorded} or any(
        r.reliability is QosReliability.RELIABLE for r in recorded
    )
    latched = [r for r in recorded if r.durability is QosDurability.TRANSIENT_LOCAL]
    depth = PLAYED_DEPTH
    if latched:
        known = [r.depth for r in latched if r.history is QosHistory.KEEP_LAST and r.depth > 0]
        depth = max(known, default=LATCHED_DEPTH)
    return _profile(depth, reliable, bool(latched))


def _profile(depth: int, reliable: bool, latched: bool) -> QoSProfile:
    return QoSProfile(
        history=HistoryPolicy.KEEP_LAST,
        depth=depth,
        reliability=ReliabilityPolicy.RELIABLE if reliable else ReliabilityPolicy.BEST_EFFORT,
        durability=DurabilityPolicy.TRANSIENT_LOCAL if latched else DurabilityPolicy.VOLATILE,
    )


def _time(duration: Duration) -> QosTime:
    nanoseconds = duration.nanoseconds
    if nanoseconds <= 0 or duration == Infinite:
        return INFINITE
    return QosTime(*divmod(nanoseconds, NANOSECONDS))


# All publishers of a topic are not discovered at once. Their offers are written down after this.
SETTLE_S = 0.4
# So many messages of the middleware may be ahead of their copies on the lane.
MOST_AHEAD = 2048
# The middleware's copies of messages from the lane may come so late, s.
UNDERWAY_S = 2.0
# A subscription that replaces another one runs beside it for so long: no message is missed.
OVERLAP_S = 1.0


class RecordedTopic:
    """Puts every message of one topic into a spool.

    Args:
        node: that subscribes.
        spool: of the bag.
        name: absolute name.
        msgtype: such as ``std_msgs/msg/UInt8``.
        clock: gives the time of reception, ns, of a message with its info; 0 if there is none yet.
        exchange: brings what comes over the lane.
        watch: called with the times (ns) and bytes of messages as they come, if set.

    Attributes:
        count: messages recorded.
        lost: numbers missing in the sequence of the topic's one publisher; None with several, whose
            numbers the middleware does not distinguish.
        untimed: messages left out because there was no time yet.

    Raises:
        BagError: no such message type is installed.
    """

    def __init__(
        self,
        node: Node,
        spool: BagSpool,
        name: str,
        msgtype: str,
        clock: Callable[[Info], int],
        exchange: Exchange,
        watch: Callable[[Messages], None] | None = None,
    ) -> None:
        self._watch = watch
        self.name, self.type = name, msgtype
        self.count = 0
        self.untimed = 0
        self._lost = 0
        self._publishers = 0
        self._node, self._spool, self._clock = node, spool, clock
        self._class = message_class(msgtype)
        self._held: list[tuple[int, bytes | memoryview]] | None = []
        self._request: QoSProfile | None = None
        self._subscription: Any = None
        self._old: Any = None
        self._key = (0, 0)
        self._sent: dict[int, int] = {}
        self._lane_s = float("-inf")
        self._had = exchange.listen_to_all(name, self._hear_on_lane, self._class.__name__)
        self._doubles: set[tuple[int, int]] = set()
        self._ahead: dict[tuple[int, bytes], None] = {}
        self._begun = self._replaced = time.monotonic()

    @property
    def is_settled(self) -> bool:
        """Whether nothing is left to be done unless its publishers change."""
        return self._held is None and self._old is None

    @property
    def is_announced(self) -> bool:
        """Whether it is in the bag."""
        return self._held is None

    @property
    def lost(self) -> int | None:
        """See the class."""
        return self._lost if self._publishers <= 1 else None

    def follow(self, offered: Sequence[QoSProfile], now_s: float) -> None:
        """Subscribe as the publishers allow, and announce the topic once they are all known.

        Args:
            offered: what each publisher offers at present.
            now_s: monotonic time.
        """
        self._publishers = max(self._publishers, len(offered))
        wanted = adapted_request(offered)
        if self._request is None or _is_weaker(wanted, self._request):
            self._subscribe(wanted, now_s)
        if self._old is not None and now_s - self._replaced >= OVERLAP_S:
            self._node.destroy_subscription(self._old)
            self._old = None
            self._doubles.clear()
        if self._held is not None and now_s - self._begun >= SETTLE_S:
            self.announce(offered)

    def forget_losses(self) -> None:
        """Count losses from now on."""
        self._lost = 0

    def expect(self, request: QoSProfile, offered: Qos) -> None:
        """Subscribe to and announce a topic whose publishers are known before they are there.

        Args:
            request: of the subscription.
            offered: what its publishers will offer.
        """
        self._publishers = 1
        self._subscribe(request, self._begun)
        self._held = None
        self._spool.add_topic(self.name, self.type, [offered])

    def announce(self, offered: Sequence[QoSProfile]) -> None:
        """Put the topic into the bag, if it is not there yet, with the messages until now."""
        if self._held is None:
            return
        held, self._held = self._held, None
        self._spool.add_topic(self.name, self.type, [as_recorded(offer) for offer in offered])
        self._spool.put(self.name, held)

    def _subscribe(self, wanted: QoSProfile, now_s: float) -> None:
        if self._old is not None:
            self._node.destroy_subscription(self._old)
        self._old, self._request = self._subscription, wanted
        if self._old is not None:
            self._replaced = now_s
            self._doubles.add(self._key)
        self._subscription = self._node.create_subscription(
            self._class, self.name, WithInfo(self._receive), wanted, raw=True
        )

    def _hear_on_lane(self, batch: Batch) -> None:
        sent, self._lane_s = self._sent, time.monotonic()
        for _, origin in batch:
            number = origin.sent
            self._lost += number - sent.get(origin.via, number - 1) - 1
            sent[origin.via] = number
        if self._ahead:
            batch = [item for item in batch if not self._was_ahead(*item)]
        self._keep([(origin.sent_ns, data) for data, origin in batch])

    def _was_ahead(self, data: bytes, origin: Origin) -> bool:
        """Return whether the middleware has brought a message before, and forget that."""
        key = origin.number, data
        return key in self._ahead and self._ahead.pop(key) is None

    def _receive(self, data: bytes, info: Info) -> None:
        had = self._had(data)
        number = info["publication_sequence_number"] or 0
        key = (info["source_timestamp"], number)
        if self._old is not None:
            if key in self._doubles:
                return
            self._doubles.add(key)
        # A lower number is from a restarted publisher. While the lane delivers messages, losses are
        # counted there: messages that only the middleware dropped were received.
        by_middleware = time.monotonic() - self._lane_s > UNDERWAY_S
        if self._key[1] and number > self._key[1] and by_middleware:
            self._lost += number - self._key[1] - 1
        self._key = key
        if had:
            return
        if self._sent:
            self._ahead[number, data] = None
            if len(self._ahead) > MOST_AHEAD:
                del self._ahead[next(iter(self._ahead))]
        time_ns = self._clock(info)
        if time_ns:
            self._keep([(time_ns, data)])
        else:
            self.untimed += 1

    def _keep(self, messages: Messages) -> None:
        if not messages:
            # The middleware was ahead with all of them.
            return
        self.count += len(messages)
        if self._watch is not None:
            self._watch(messages)
        if self._held is None:
            self._spool.put(self.name, messages)
        else:
            self._held += messages


def _is_weaker(wanted: QoSProfile, present: QoSProfile) -> bool:
    """Return whether a new publisher is incompatible with the present subscription."""
    reliable, latched = ReliabilityPolicy.RELIABLE, DurabilityPolicy.TRANSIENT_LOCAL
    return bool(
        (present.reliability == reliable and wanted.reliability != reliable)
        or (present.durability == latched and wanted.durability != latched)
    )
