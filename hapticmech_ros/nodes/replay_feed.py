# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Recorded inputs for a graph in lockstep: for every tick, what was there at its time.

A hand's wrenches, a device's samples or the environment's wrenches are taken from the control-rate
messages of a bag and published stamped for each tick, which waits for them. Where a live recording
has no sample for a tick, the last one before it stands.
"""

from __future__ import annotations

import bisect
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from geometry_msgs.msg import WrenchStamped
from rclpy.node import Node
from rclpy.publisher import Publisher
from std_msgs.msg import Float64MultiArray

from hapticmech_ros.arrays import Array
from hapticmech_ros.bag.reader import BagReader
from hapticmech_ros.errors import BagError
from hapticmech_ros.feeds import check_feeds
from hapticmech_ros.mechanism import Mechanism
from hapticmech_ros.mechanism.grasp import flat_grasps
from hapticmech_ros.nodes.messages import write_wrench
from hapticmech_ros.nodes.qos import LOCKSTEP
from hapticmech_ros.scene import Scene
from hapticmech_ros.times import NANOSECONDS
from hapticmech_ros.wire.cdr import FlatArray, decode, header_stamp
from hapticmech_ros.wire.layouts import DEVICE_FIELDS, unpack_device, whole_device
from hapticmech_ros.wire.state import StateLayout
from hapticmech_ros.wire.topics import (
    DEVICE_COMMAND,
    DEVICE_STATE,
    EXTERNAL_WRENCH,
    HAND_WRENCH,
    STATE,
    TOPICS,
)

_DEVICE = FlatArray(DEVICE_FIELDS)


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
        """Publish what belongs to the tick at a time."""
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
        rows = [whole_device(decode(data)) for data in _messages(bag, DEVICE_STATE.name)]
        commands = _messages(bag, DEVICE_COMMAND.name)
        states = _messages(bag, STATE.name) if "external" in kinds else []
    if not rows or not commands:
        raise BagError(f"bag {path}: nothing on device/state or device/servo_cf to start from")
    samples = [unpack_device(row) for row in rows]
    stamps = [sample.stamp_ns for sample in samples]
    tracks = []
    if "hand" in kinds:
        wrenches = np.array([sample.measured.hand_wrench for sample in samples])
        tracks.append(Track(HAND_WRENCH.name, stamps, wrenches, _wrench, WrenchStamped))
    if "device" in kinds:
        tracks.append(Track(DEVICE_STATE.name, stamps, np.array(rows), _device, Float64MultiArray))
    if "external" in kinds:
        mechanism = Mechanism(scene)
        layout = StateLayout(mechanism)
        decoded = [layout.unpack(decode(data)) for data in states]
        if any((state.grasps != flat_grasps(scene)).any() for state in decoded):
            raise BagError(
                f"bag {path}: held elsewhere than the scene says, so it cannot be replayed"
            )
        times = [state.stamp_ns for state in decoded]
        for index, name in enumerate(mechanism.point_names):
            values = np.array([state.contacts[index] for state in decoded])
            topic = EXTERNAL_WRENCH.of(name)
            tracks.append(Track(topic, times, values, _wrench, WrenchStamped))
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


def _wrench(value: Array, time_ns: int) -> WrenchStamped:
    message = WrenchStamped()
    write_wrench(message, value, time_ns)
    return message
