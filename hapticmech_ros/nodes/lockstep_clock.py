# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Paces a graph in lockstep: /clock advances only when every node has done its part.

A tick is complete when all control topics have been received for its time. The graph then runs as
fast as possible, with the same bits on every run, on any machine. Recording happens here too: the
graph waits for the recorder, which therefore loses nothing.

Recorded inputs (a hand's wrenches, a device's samples or the environment's wrenches) are taken from
the control-rate messages of a bag and published stamped for each tick, which waits for them. Where
a live recording has no sample for a tick, the last one before it stands.
"""

from __future__ import annotations

import argparse
import bisect
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import rclpy
from geometry_msgs.msg import WrenchStamped
from rclpy.experimental import EventsExecutor
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.serialization import serialize_message
from rclpy.signals import SignalHandlerOptions
from rclpy.task import Future
from rosgraph_msgs.msg import Clock
from std_msgs.msg import Float64MultiArray

from hapticmech_ros.bag.reader import BagReader
from hapticmech_ros.bag.writer import BagWriter
from hapticmech_ros.errors import BagError, HapticMechError, InvalidInputError
from hapticmech_ros.loading import load_scene
from hapticmech_ros.mechanism import Mechanism
from hapticmech_ros.mechanism.closures import flat_grasps
from hapticmech_ros.nodes.loop import (
    LONGEST_WAIT_S,
    QuietEventsNode,
    StopRequest,
    wait_for_messages,
    write_progress,
)
from hapticmech_ros.nodes.messages import (
    LATCHED,
    LOCKSTEP,
    RECORDER_SUBSCRIBER,
    STREAM_PUBLISHER,
    message_class,
    set_stamp,
    wrench_message,
)
from hapticmech_ros.numerics import Array
from hapticmech_ros.numerics.times import NANOSECONDS, nanoseconds
from hapticmech_ros.scene import Scene
from hapticmech_ros.wire.bounds import read
from hapticmech_ros.wire.cdr import FlatArray, array_stamp, decode, header_stamp
from hapticmech_ros.wire.messages import DeviceStateMessage
from hapticmech_ros.wire.state import StateLayout
from hapticmech_ros.wire.topics import (
    ARRAY,
    DEVICE_COMMAND,
    DEVICE_STATE,
    EXTERNAL_WRENCH,
    HAND_WRENCH,
    STATE,
    TOPICS,
    VIEWER,
    Topic,
    check_feeds,
)

_DEVICE = FlatArray(DeviceStateMessage.layout)


@dataclass(frozen=True, slots=True)
class Track:
    """One recorded quantity over time, held between samples.

    Attributes:
        topic: relative topic to publish on.
        stamps: (n,) ns, ascending.
        values: (n, size).
        encode: (value, time in ns) -> message, or its bytes.
        message_type: of the topic.
    """

    topic: str
    stamps: list[int]
    values: Array
    encode: Callable[[Array, int], Any]
    message_type: Any

    def at(self, time_ns: int) -> Array:
        """Return the last value (size,) no later than a time; the first one before all of them."""
        index = max(bisect.bisect_right(self.stamps, time_ns) - 1, 0)
        return np.asarray(self.values[index])


class Feed:
    """Tracks to be published tick by tick.

    Attributes:
        start_ns: time of the first tick: of the first command to the device in the bag.
        duration_s: length of the recording from then on, s.
    """

    def __init__(
        self, tracks: Sequence[Track], start_ns: int, end_ns: int, period_s: float
    ) -> None:
        self._tracks = tuple(tracks)
        self._publishers: list[Publisher] = []
        self.start_ns = start_ns
        self.duration_s = (end_ns - start_ns) / NANOSECONDS + period_s

    def advertise(self, node: Node) -> None:
        """Create the publishers."""
        self._publishers = [
            node.create_publisher(track.message_type, track.topic, LOCKSTEP)
            for track in self._tracks
        ]

    def publish(self, time_ns: int) -> None:
        """Publish the inputs of the tick at a time."""
        for track, publisher in zip(self._tracks, self._publishers, strict=True):
            publisher.publish(track.encode(track.at(time_ns), time_ns))


def feed_from_bag(path: Path, scene: Scene, kinds: Sequence[str]) -> Feed:
    """Return the inputs of ``kinds`` (hand, device, external) that a bag holds.

    Raises:
        InvalidInputError: another kind, or the bag's mechanism is not the scene's.
        BagError: no such bag, or without the control-rate topics that are needed.
    """
    check_feeds(kinds)
    with BagReader(path) as bag:
        states = _messages(bag, DEVICE_STATE.name)
        samples = [read(DeviceStateMessage, decode(data)) for data in states]
        commands = _messages(bag, DEVICE_COMMAND.name)
        states = _messages(bag, STATE.name) if "external" in kinds else []
    if not samples or not commands:
        raise BagError(f"bag {path}: nothing on device/state or device/servo_cf to start from")
    stamps = [sample.stamp_ns for sample in samples]
    tracks = []
    if "hand" in kinds:
        wrenches = np.array([sample.sample.hand_wrench for sample in samples])
        tracks.append(Track(HAND_WRENCH.name, stamps, wrenches, wrench_message, WrenchStamped))
    if "device" in kinds:
        rows = np.array([sample.values for sample in samples])
        tracks.append(Track(DEVICE_STATE.name, stamps, rows, _device, Float64MultiArray))
    if "external" in kinds:
        mechanism = Mechanism(scene)
        layout = StateLayout(mechanism)
        decoded = [layout.unpack(decode(data)) for data in states]
        if any((state.grasps != flat_grasps(scene)).any() for state in decoded):
            rule = "an operational point is not where the scene has it, so it cannot be replayed"
            raise BagError(f"bag {path}: {rule}")
        times = [state.stamp_ns for state in decoded]
        for index, name in enumerate(mechanism.point_names):
            values = np.array([state.contacts[index] for state in decoded])
            topic = EXTERNAL_WRENCH.of(name)
            tracks.append(Track(topic, times, values, wrench_message, WrenchStamped))
    return Feed(tracks, header_stamp(commands[0]), stamps[-1], scene.simulation.period)


def _device(row: Array, time_ns: int) -> bytes:
    """Return a device's sample with another stamp."""
    return _DEVICE.encode(np.concatenate((divmod(time_ns, NANOSECONDS), row[2:])))


def _messages(bag: BagReader, relative: str) -> list[bytes]:
    """Return the serialized messages of the one topic of this relative name, in any namespace."""
    longer = tuple(f"/{topic.name}" for topic in TOPICS if topic.name.endswith(f"/{relative}"))
    ends = f"/{relative}"
    names = [name for name in bag.topics if name.endswith(ends) and not name.endswith(longer)]
    if len(names) != 1:
        found = ", ".join(names) or "none"
        raise BagError(f"bag {bag.path}: needs one topic .../{relative} (found {found})")
    return [data for _, _, data in bag.serialized(names[0])]


CLOCK = "/clock"
# Subscriptions to /clock are best effort: a tick's time is published again for those that missed
# it.
RETELL_PERIOD_S = 0.05
# It ends once no message has come for so long; it waits for that so often at most.
QUIET_S, MOST_QUIET = 0.1, 20
PROGRESS_PERIOD_S = 0.2


class LockstepError(HapticMechError):
    """The graph does not go on: some topic is silent."""


class LockstepClock(QuietEventsNode):
    """Publishes the time, tick by tick.

    Args:
        scene: its period is the tick.
        points: operational points that controllers hold, with the namespace of each.
        start_ns: time of the first tick, ns; not zero, which ROS takes for "no time yet".
        feed: inputs published for every tick before its time.
        writer: of a recording of all received messages; None for none.
    """

    def __init__(
        self,
        scene: Scene,
        points: Sequence[tuple[str, str]],
        start_ns: int,
        feed: Feed | None = None,
        writer: BagWriter | None = None,
    ) -> None:
        super().__init__("lockstep_clock")
        self.period_ns = nanoseconds(scene.simulation.period)
        self.time_ns = start_ns
        # Complete ones.
        self.ticks = 0
        self.last_received_s = time.monotonic()
        self._writer = writer
        self._feed = feed
        self._received: set[str] = set()
        self._awaited: dict[str, int] = {}
        self._missing: set[str] = set()
        self.completed = Future()
        self._message = Clock()
        self._publisher = self.create_publisher(Clock, CLOCK, STREAM_PUBLISHER)
        if writer is not None:
            writer.add_topic(CLOCK, "rosgraph_msgs/msg/Clock")
        if feed is not None:
            feed.advertise(self)
        for namespace, point in points:
            for topic in TOPICS:
                if topic.publisher != VIEWER:
                    self._listen(topic, namespace, point)

    def retell(self) -> None:
        """Publish the time once more, for nodes that missed it."""
        self._publisher.publish(self._message)

    def missing(self) -> list[str]:
        """Return the topics that have not been received for the present time."""
        return sorted(self._missing)

    def begin(self) -> None:
        """Begin the tick of the present time: publish its inputs, and the time."""
        self.completed = Future()
        self._missing = {
            name for name, received in self._awaited.items() if received < self.time_ns
        }
        if self._feed is not None:
            self._feed.publish(self.time_ns)
        set_stamp(self._message.clock, self.time_ns)
        self._publisher.publish(self._message)
        if self._writer is not None:
            self._writer.write(CLOCK, self.time_ns, serialize_message(self._message))

    def _listen(self, topic: Topic, namespace: str, point: str) -> None:
        name = self.resolve_topic_name(topic.of(point, namespace))
        control = topic.rate == "control"
        if name in self._received or not (control or self._writer):
            return
        self._received.add(name)
        if control:
            self._awaited[name] = -1
        if self._writer is not None:
            self._writer.add_topic(name, topic.type, topic.qos)
        stamp_of = array_stamp if topic.type == ARRAY else header_stamp

        def received(data: bytes) -> None:
            if self._writer is not None:
                self._writer.write(name, self.time_ns, data)
            if control:
                try:
                    self._awaited[name] = stamp_of(data)
                except InvalidInputError:
                    # Another node's: its subscriber refuses and logs it.
                    return
                self.last_received_s = time.monotonic()
                if self._awaited[name] >= self.time_ns:
                    self._missing.discard(name)
                    if not self._missing and not self.completed.done():
                        self.completed.set_result(None)

        qos = LATCHED if topic.qos == "latched" else LOCKSTEP
        if topic.publisher in ("any", "every node"):
            qos = RECORDER_SUBSCRIBER
        self.create_subscription(message_class(topic.type), name, received, qos, raw=True)


def main(arguments: Sequence[str]) -> int:
    """Pace the graph until it is over, a signal, or a stall; return the exit code."""
    parser = argparse.ArgumentParser(prog="lockstep_clock", description=__doc__)
    parser.add_argument("--scene", required=True)
    parser.add_argument("--control-rate", type=float, default=0.0, help="Hz; 0: the scene's own")
    parser.add_argument("--duration", type=float, default=0.0, help="s; 0: until a signal")
    parser.add_argument("--rate", type=float, default=0.0, help="times real time; 0: no limit")
    parser.add_argument("--start", type=int, default=NANOSECONDS, help="first time, ns")
    parser.add_argument("--hold", action="append", default=[], help="[NAMESPACE/]POINT held")
    parser.add_argument("--out", type=Path, help="bag folder to make")
    parser.add_argument("--storage", choices=("mcap", "sqlite3"), default="mcap")
    parser.add_argument("--feed-from", type=Path, help="bag whose inputs are fed")
    parser.add_argument("--feed", action="append", default=[], help="hand, device or external")
    parser.add_argument("--stall-timeout", type=float, default=30.0, help="s of silence endured")
    options, ros_arguments = parser.parse_known_args(list(arguments))
    stop = StopRequest()
    rclpy.init(args=ros_arguments, signal_handler_options=SignalHandlerOptions.NO)
    writer: BagWriter | None = None
    try:
        scene = load_scene(options.scene, options.control_rate)
        points = [_held(text) for text in options.hold] or [("", scene.held_points[0])]
        feed = None
        if options.feed_from is not None:
            feed = feed_from_bag(options.feed_from, scene, options.feed)
            options.start = feed.start_ns
            options.duration = options.duration or feed.duration_s
        writer = BagWriter(options.out, options.storage) if options.out else None
        node = LockstepClock(scene, points, options.start, feed, writer)
        ticks = round(options.duration / scene.simulation.period)
        _pace(node, stop, ticks, options.rate, options.stall_timeout)
        write_progress("done", ticks=node.ticks)
        node.destroy_node()
        return 0
    except HapticMechError as error:
        write_progress("failed", reason=str(error))
        return 1
    finally:
        if writer is not None:
            writer.close()
        rclpy.try_shutdown()


def _pace(
    node: LockstepClock, stop: StopRequest, ticks: int, rate: float, stall_timeout_s: float
) -> None:
    """Advance until so many ticks are complete (0: for ever) or a signal comes."""
    executor = EventsExecutor()
    executor.add_node(node)
    node.begin()
    due = reported = time.monotonic()
    while rclpy.ok() and not stop.asked:
        wait_for_messages(executor, RETELL_PERIOD_S, until=node.completed)
        if time.monotonic() - reported > PROGRESS_PERIOD_S:
            reported = time.monotonic()
            write_progress("progress", ticks=node.ticks, every=ticks)
        if not node.completed.done():
            node.retell()
            if time.monotonic() - node.last_received_s > stall_timeout_s:
                silent = ", ".join(node.missing())
                raise LockstepError(f"lockstep: nothing on {silent} for {stall_timeout_s:g} s")
            continue
        node.ticks += 1
        if node.ticks == ticks:
            break
        if rate:
            due += node.period_ns / NANOSECONDS / rate
            while (ahead := due - time.monotonic()) > 0.0 and not stop.asked:
                wait_for_messages(executor, min(ahead, LONGEST_WAIT_S))
        node.time_ns += node.period_ns
        node.begin()
    for _ in range(MOST_QUIET):
        if time.monotonic() - node.last_received_s < QUIET_S:
            wait_for_messages(executor, QUIET_S)
    executor.shutdown()


def _held(text: str) -> tuple[str, str]:
    namespace, _, point = text.rpartition("/")
    return namespace, point


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
