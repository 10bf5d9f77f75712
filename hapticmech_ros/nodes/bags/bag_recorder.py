# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Records topics of a running graph into a rosbag2 bag, as they are on the wire."""

from __future__ import annotations

import math
import os
import re
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import rclpy
from rclpy.experimental import EventsExecutor
from rclpy.parameter import Parameter
from rclpy.qos import QoSProfile
from rclpy.signals import SignalHandlerOptions
from rosbags.typesys import Stores, get_typestore

from hapticmech_ros.bag.storage import Messages
from hapticmech_ros.bag.writer import BagWriter
from hapticmech_ros.errors import BagError, HapticMechError
from hapticmech_ros.nodes.bags.recorded_topic import BagSpool, RecordedTopic
from hapticmech_ros.nodes.exchange import Exchange
from hapticmech_ros.nodes.loop import Inbox, QuietEventsNode, StopRequest, prepare_to_gather
from hapticmech_ros.nodes.sources import Info
from hapticmech_ros.numerics.times import nanoseconds
from hapticmech_ros.system.discovery import Transport
from hapticmech_ros.system.readiness import report_ready
from hapticmech_ros.wire.topics import Rate, topic_of

DISCOVERY_PERIOD_S = 0.2
# Publishers of topics that are recorded already are counted less often, s: it takes as long as
# recording a thousand messages.
COUNT_PERIOD_S = 1.0
# A graph is not recorded whole before something came from each topic whose publisher never pauses;
# those that are still silent after so long, s, are not waited for.
NEVER_PAUSE: tuple[Rate, ...] = ("control", "view", "marker", "1 Hz")
SILENT_S = 10.0
# s, for which a recorder at its end takes messages received before.
DRAIN_S = 3.0


@dataclass(frozen=True, slots=True)
class RecordOptions:
    """Options of recording.

    Attributes:
        path: bag folder to make.
        topics: names; relative ones are below ``namespace``. Every topic if neither these nor
            ``regex`` are given.
        regex: topics whose names match this, besides ``topics``.
        namespace: of the graph; with neither topics nor a regex, only topics below it.
        storage: ``mcap`` or ``sqlite3``.
        split_bytes: begin a new file at this size.
        split_s: begin a new file after so long, s.
        duration_s: end by itself after so long, s.
        use_sim_time: time of reception is the graph's ``/clock``, not the machine's.
        transport: ``auto``: messages that processes of this host send over the lane are received
            there.
    """

    path: Path
    topics: tuple[str, ...] = ()
    regex: str = ""
    namespace: str = ""
    storage: str = "mcap"
    split_bytes: int | None = None
    split_s: float | None = None
    duration_s: float | None = None
    use_sim_time: bool = False
    transport: Transport = "auto"


class BagRecorderNode(QuietEventsNode):
    """Subscribes to wanted topics as soon as they have a publisher.

    Args:
        spool: of the bag.
        options: of the recording.
        exchange: delivers messages from the lane.

    Raises:
        BagError: a regex that is none.
    """

    def __init__(self, spool: BagSpool, options: RecordOptions, exchange: Exchange) -> None:
        super().__init__(
            "bag_recorder",
            namespace=options.namespace or None,
            enable_rosout=False,
            start_parameter_services=False,
            parameter_overrides=[Parameter("use_sim_time", value=options.use_sim_time)],
        )
        self._spool, self._exchange = spool, exchange
        self._by_graph = options.use_sim_time
        self._names = {self.resolve_topic_name(name) for name in options.topics}
        self._below = "/" + options.namespace.strip("/") if options.namespace.strip("/") else ""
        try:
            self._regex = re.compile(options.regex) if options.regex else None
        except re.error as error:
            raise BagError(f"regex {options.regex!r}: {error}") from None
        self._store = get_typestore(Stores.ROS2_JAZZY)
        self.received: dict[str, RecordedTopic] = {}
        self._counted: dict[str, int] = {}
        self._counted_s = -COUNT_PERIOD_S
        self.skipped: dict[str, str] = {}

    def discover(self) -> None:
        """Look at the graph: subscribe to new topics, adapt to new publishers."""
        now = time.monotonic()
        counts = now - self._counted_s >= COUNT_PERIOD_S
        self._counted_s = now if counts else self._counted_s
        for name, types in self.get_topic_names_and_types():
            if name in self.skipped or not self._wants(name):
                continue
            topic = self.received.get(name)
            if topic is not None and topic.is_settled and not counts:
                continue
            count = self.count_publishers(name)
            if topic is not None and topic.is_settled and count == self._counted.get(name):
                continue
            self._counted[name] = count
            offered, hashes = self._offers(name)
            if topic is None and offered:
                topic = self._receive(name, types, hashes)
            if topic is not None and offered:
                topic.follow(offered, now)

    def receive(
        self, name: str, msgtype: str, watch: Callable[[Messages], None] | None = None
    ) -> RecordedTopic:
        """Begin with a topic, and return it.

        Args:
            name: absolute name.
            msgtype: such as ``std_msgs/msg/UInt8``.
            watch: called with the times (ns) and bytes of messages as they come.

        Raises:
            BagError: no such message type is installed.
        """
        made = RecordedTopic(self, self._spool, name, msgtype, self._time_ns, self._exchange, watch)
        self.received[name] = made
        return made

    @property
    def receives(self) -> bool:
        """Whether a message has come."""
        return any(topic.count for topic in self.received.values())

    def silent(self) -> list[str]:
        """Return topics with a publisher that nothing came from, of those that never pause."""
        return [
            name
            for name, topic in sorted(self.received.items())
            if self._counted.get(name)
            and not topic.count
            and (known := topic_of(name)) is not None
            and known.rate in NEVER_PAUSE
        ]

    def finish(self) -> None:
        """Announce topics received too briefly to be announced until now, and note losses."""
        silent = self.silent()
        for topic in self.received.values():
            if not topic.is_announced:
                topic.announce(self._offers(topic.name)[0])
            self._spool.note_lost(topic.name, None if topic.name in silent else topic.lost)

    def missing(self) -> list[str]:
        """Return topics requested by name that were not published."""
        return sorted(self._names - set(self.received) - set(self.skipped))

    def _wants(self, name: str) -> bool:
        if name in self._names:
            return True
        if any(part.startswith("_") for part in name.split("/")):
            return False
        if self._regex is not None:
            return self._regex.search(name) is not None
        return not self._names and name.startswith(f"{self._below}/")

    def _offers(self, name: str) -> tuple[list[QoSProfile], set[str]]:
        """Return other publishers' QoS on a topic, and the hashes of its type that they state."""
        own = (self.get_name(), self.get_namespace())
        others = [
            info
            for info in self.get_publishers_info_by_topic(name)
            if (info.node_name, info.node_namespace) != own
        ]
        return [o.qos_profile for o in others], {str(o.topic_type_hash) for o in others}

    def _receive(self, name: str, types: list[str], hashes: set[str]) -> RecordedTopic | None:
        reason = self._refusal(types, hashes)
        if not reason:
            try:
                self.receive(name, types[0])
            except BagError as error:
                reason = str(error)
        if reason:
            self.skipped[name] = reason
            sys.stderr.write(f"{name} is not recorded: {reason}\n")
        return self.received.get(name)

    def _refusal(self, types: list[str], hashes: set[str]) -> str:
        if len(types) != 1:
            return f"it has several types: {', '.join(types)}"
        if types[0] not in self._store.types:
            return f"{types[0]!r} is not a message type of ROS 2 Jazzy"
        known = str(self._store.hash_rihs01(types[0]))
        stated = {text for text in hashes if text.startswith("RIHS01_")}
        if stated - {known}:
            return f"the publisher's {types[0]} is not the one of ROS 2 Jazzy"
        return ""

    def _time_ns(self, info: Info) -> int:
        if self._by_graph:
            return int(self.get_clock().now().nanoseconds)
        return int(info["received_timestamp"]) or time.time_ns()


def record(options: RecordOptions) -> int:
    """Record until a signal, or the duration's end; print a report; return the exit code."""
    stop = StopRequest()
    rclpy.init(args=[], signal_handler_options=SignalHandlerOptions.NO)
    node: BagRecorderNode | None = None
    exchange = Exchange()
    # Nodes that follow /clock are not on the lane.
    if options.transport == "auto" and not options.use_sim_time:
        exchange.join_lane(os.environ)
    try:
        writer = BagWriter(
            options.path,
            options.storage,
            split_bytes=options.split_bytes,
            split_ns=None if options.split_s is None else nanoseconds(options.split_s),
        )
        spool = BagSpool(writer)
        try:
            node = BagRecorderNode(spool, options, exchange)
            _record(node, spool, exchange, stop, options)
        finally:
            spool.close()
        _report(node, spool, options.path)
        return 0
    except HapticMechError as error:
        sys.stderr.write(f"error: {error}\n")
        return 1
    finally:
        # First: other processes then expect no more from this one.
        exchange.close()
        if node is not None:
            node.destroy_node()
        rclpy.try_shutdown()


def _record(
    node: BagRecorderNode,
    spool: BagSpool,
    exchange: Exchange,
    stop: StopRequest,
    options: RecordOptions,
) -> None:
    executor = EventsExecutor()
    executor.add_node(node)
    prepare_to_gather()
    inbox = Inbox(executor, exchange)
    begun = time.monotonic()
    looked, ready, received = -DISCOVERY_PERIOD_S, False, math.inf
    print(f"recording into {options.path}; Ctrl-C ends it", flush=True)
    while rclpy.ok() and not stop.asked and not spool.failure:
        now = time.monotonic() - begun
        if options.duration_s is not None and now >= options.duration_s:
            break
        if now - looked >= DISCOVERY_PERIOD_S:
            looked, known = now, len(node.received)
            node.discover()
            received = min(received, now) if node.receives else math.inf
            # No topic is new, and messages come: in a part of a graph perhaps not on every topic.
            late = now - received >= SILENT_S
            if not ready and len(node.received) == known and node.receives:
                ready = late or not node.silent()
                if ready:
                    report_ready()
        inbox.gather()
    # On a busy machine it is behind.
    inbox.drain(DRAIN_S)
    node.finish()
    executor.remove_node(node)


def _report(node: BagRecorderNode, spool: BagSpool, path: Path) -> None:
    total = sum(topic.count for topic in node.received.values())
    print(f"{path}: {total} messages of {len(node.received)} topics")
    for name, topic in sorted(node.received.items()):
        lost = "losses unknown: several publishers" if topic.lost is None else f"{topic.lost} lost"
        lost = lost if topic.count else "losses unknown"
        untimed = f", {topic.untimed} before the first /clock left out" if topic.untimed else ""
        print(f"  {name}: {topic.count} messages, {lost}{untimed}")
    for name, reason in sorted(node.skipped.items()):
        print(f"  {name}: not recorded, {reason}")
    if silent := node.silent():
        print(f"  no messages from {', '.join(silent)}: not sent, or the machine was too busy")
    for name in node.missing():
        print(f"  {name}: not published")
    if spool.dropped:
        print(f"  {sum(spool.dropped.values())} messages dropped: the disk was too slow")
    sys.stdout.flush()
