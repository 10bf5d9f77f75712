# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Watches a graph from outside: every control message, when it arrived, and what nodes say.

``python -m benchmarks.reliability.watch RING [POINT]``; with a point it also hears the mechanism's
and the analyser's messages. Samples go into a ring that the parent reads; what nodes say in their
diagnostics and logs, and how many publishers the topics have that one node may speak on, is told
by lines of JSON. Times of arrival are by the monotonic clock.
"""

from __future__ import annotations

import gc
import sys
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import WrenchStamped
from rcl_interfaces.msg import Log
from rclpy.node import Node
from std_msgs.msg import Float64MultiArray

from benchmarks.reliability.sample import COMMAND, DEVICE, MECHANISM, POINT_MODEL, Ring
from benchmarks.watching import watch
from hapticmech_ros.errors import HapticMechError
from hapticmech_ros.nodes.loop import wake_up_in_time, write_progress
from hapticmech_ros.nodes.messages import RECORDER_SUBSCRIBER
from hapticmech_ros.nodes.realtime import Realtime, Request
from hapticmech_ros.nodes.sources import Info, WithInfo
from hapticmech_ros.numerics.times import NANOSECONDS
from hapticmech_ros.wire import topics
from hapticmech_ros.wire.bounds import read
from hapticmech_ros.wire.cdr import decode
from hapticmech_ros.wire.messages import DeviceStateMessage
from hapticmech_ros.wire.wrench import decode_wrench

NAN = float("nan")
# After nodes in real time, before all else: an ordinary process gets what they leave of the
# processor that it is on, and may be late by a second.
REQUEST = Request("auto", 10)
# Publishers of these are counted so often, s.
OWNED = (
    topics.DEVICE_STATE,
    topics.DEVICE_POSE,
    topics.DEVICE_COMMAND,
    topics.DEVICE_GAIN,
    topics.STATE,
)
COUNTED_S = 0.01
# What a sample of the ring can hold.
LAST = 1 << 63
Told = tuple[int, float, float]


class GraphWatch(Node):
    """Puts every control message into the ring and tells what the nodes say."""

    def __init__(self, ring: Ring, point: str = "") -> None:
        super().__init__("graph_watch")
        self._ring = ring
        self._last: dict[str, str] = {}
        self._listen(DEVICE, topics.DEVICE_STATE.name, Float64MultiArray, _device)
        self._listen(COMMAND, topics.DEVICE_COMMAND.name, WrenchStamped, _command)
        if point:
            self._listen(MECHANISM, topics.STATE.name, Float64MultiArray, _stamped)
            self._listen(POINT_MODEL, topics.POINT_MODEL.of(point), Float64MultiArray, _stamped)
        qos = RECORDER_SUBSCRIBER
        self.create_subscription(DiagnosticArray, topics.DIAGNOSTICS.name, self._on_status, qos)
        self.create_subscription(Log, "/rosout", self._on_log, qos)
        counted = [topic.name for topic in OWNED] + [topics.POINT_MODEL.of(point)] * bool(point)
        self._counted = dict.fromkeys(counted, 0)
        self.create_timer(COUNTED_S, self._count)
        self._realtime = Realtime(REQUEST)

    def _listen(self, topic: int, name: str, kind: type, read: Callable[[bytes], Told]) -> None:
        def keep(message: bytes, info: Info) -> None:
            now = time.monotonic_ns()
            try:
                stamp, force, torque = read(message)
            except (HapticMechError, ArithmeticError, ValueError):
                stamp, force, torque = 0, NAN, NAN
            if not 0 <= stamp < LAST:
                stamp = 0
            number = info["publication_sequence_number"]
            self._ring.put((topic, now, stamp, number if number < LAST else 0, force, torque))

        self.create_subscription(kind, name, WithInfo(keep), RECORDER_SUBSCRIBER, raw=True)

    def _count(self) -> None:
        for topic, before in self._counted.items():
            if (count := self.count_publishers(topic)) != before:
                self._counted[topic] = count
                _tell("publishers", topic=topic, count=count, fewer=count < before)

    def _on_status(self, message: DiagnosticArray) -> None:
        for status in message.status:
            figures = {pair.key: pair.value for pair in status.values}
            text = "; ".join(t for t in (status.message, figures.get("fault", "")) if t)
            well = status.level == DiagnosticStatus.OK
            _tell("said", node=status.name, text=text, well=well, by="diagnostics")

    def _on_log(self, message: Log) -> None:
        well = message.level < Log.WARN
        _tell("said", node=message.name, text=message.msg, well=well, by="log")


def _tell(event: str, **facts: object) -> None:
    write_progress(event, **facts, at_ns=time.monotonic_ns())


def _device(message: bytes) -> Told:
    sample = read(DeviceStateMessage, decode(message))
    force, torque = np.linalg.norm(sample.applied.reshape(2, 3), axis=1)
    return sample.stamp_ns, float(force), float(torque)


def _command(message: bytes) -> Told:
    wrench = decode_wrench(message)
    force, torque = np.linalg.norm(wrench.values.reshape(2, 3), axis=1)
    return wrench.stamp_ns, float(force), float(torque)


def _stamped(message: bytes) -> Told:
    """Read a message whose first two numbers are a stamp."""
    seconds, nanoseconds = decode(message)[:2]
    return int(seconds) * NANOSECONDS + int(nanoseconds), 0.0, 0.0


if __name__ == "__main__":
    wake_up_in_time()
    gc.collect()
    gc.freeze()
    sys.exit(watch(lambda: GraphWatch(Ring(Path(sys.argv[1])), *sys.argv[2:]), []))
