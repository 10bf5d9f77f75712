# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Records the graph's topics as they are on the wire into a rosbag2 bag.

A process of its own, so that a slow disk delays nobody. Once it hears every topic it lets waiting
hands start. Tells its parent how it goes by lines of JSON on standard output: ready, started (a
hand pushes), progress, done or failed.
"""

from __future__ import annotations

import argparse
import os
import sys
import time
from collections.abc import Sequence
from pathlib import Path

import rclpy
from rclpy.experimental import EventsExecutor
from rclpy.serialization import deserialize_message
from rclpy.signals import SignalHandlerOptions
from std_msgs.msg import Float64MultiArray
from std_srvs.srv import Trigger

from hapticmech_ros.bag.writer import BagWriter
from hapticmech_ros.errors import HapticMechError
from hapticmech_ros.loading import load_scene
from hapticmech_ros.nodes.child import write_progress
from hapticmech_ros.nodes.exchange import Exchange
from hapticmech_ros.nodes.loop import Inbox, StopRequest
from hapticmech_ros.nodes.message_class import message_class
from hapticmech_ros.nodes.message_info import Info, WithInfo
from hapticmech_ros.nodes.origin import Origin
from hapticmech_ros.nodes.qos import LATCHED, RECORDER_SUBSCRIBER
from hapticmech_ros.nodes.quiet_events import QuietEventsNode
from hapticmech_ros.wire.layouts import unpack_device
from hapticmech_ros.wire.topic import Topic, users_of
from hapticmech_ros.wire.topics import DEVICE_STATE, START_HAND, TOPICS

# Nodes publish diagnostics once a second: recording goes on this long so that the last are in.
TAIL_S = 1.2
PROGRESS_PERIOD_S = 0.1


class RecorderNode(QuietEventsNode):
    """Writes every message of the table's topics to a bag, and sees when the first hand starts.

    Args:
        writer: of the bag.
        points: the operational points held.
        exchange: brings what comes over the lane.
    """

    def __init__(self, writer: BagWriter, points: Sequence[str], exchange: Exchange) -> None:
        super().__init__("recorder")
        self._exchange = exchange
        self._writer = writer
        self.messages = 0
        users = users_of(points)
        full = self.resolve_topic_name
        self._silent = {full(topic.of(at, space)) for space, at in users for topic in _expected()}
        self._watched = {full(DEVICE_STATE.of(at, space)) for space, at in users}
        self._start_hands = [
            self.create_client(Trigger, f"{space}/{START_HAND}" if space else START_HAND)
            for space, _ in users
        ]
        self._asked = False
        self.started_ns: int | None = None
        names = {full(topic.of(at, space)): topic for space, at in users for topic in TOPICS}
        for name, topic in names.items():
            self._record(topic, name)

    def _record(self, topic: Topic, name: str) -> None:
        self._writer.add_topic(name, topic.type, topic.qos)
        qos = LATCHED if topic.qos == "latched" else RECORDER_SUBSCRIBER
        kind = message_class(topic.type)

        def write(data: bytes, time_ns: int) -> None:
            self._writer.write(name, time_ns, data)
            self.messages += 1
            self._silent.discard(name)
            if name in self._watched and self.started_ns is None:
                self._look_for_start(data, time_ns)

        def handed(data: bytes, origin: Origin) -> None:
            write(data, origin.sent_ns or time.time_ns())

        had = self._exchange.listen(name, handed, kind.__name__, every=True)

        def callback(data: bytes, info: Info) -> None:
            if not had(data):
                write(data, int(info["received_timestamp"]) or time.time_ns())

        self.create_subscription(kind, name, WithInfo(callback), qos, raw=True)

    def start_hands_when_ready(self) -> None:
        """Let the hands start once every topic of the graph has been heard."""
        if self._asked or self._silent:
            return
        if all(client.service_is_ready() for client in self._start_hands):
            self._asked = True
            for client in self._start_hands:
                client.call_async(Trigger.Request())

    def silent(self) -> list[str]:
        """Return the topics of the graph from which nothing has come yet."""
        return sorted(self._silent)

    def _look_for_start(self, data: bytes, now_ns: int) -> None:
        measured = unpack_device(deserialize_message(data, Float64MultiArray).data).measured
        if measured.hand_wrench.any():
            self.started_ns = now_ns


def main(arguments: Sequence[str]) -> int:
    """Record until the experiment is over, a signal, or a timeout; return the exit code."""
    parser = argparse.ArgumentParser(prog="recorder", description=__doc__)
    parser.add_argument("--out", type=Path, required=True, help="bag folder to make")
    parser.add_argument("--storage", choices=("mcap", "sqlite3"), default="mcap")
    parser.add_argument("--scene", required=True)
    parser.add_argument("--duration", type=float, required=True, help="s after the hand starts")
    parser.add_argument("--start-timeout", type=float, default=30.0, help="s to wait for the hand")
    options, ros_arguments = parser.parse_known_args(list(arguments))
    stop = StopRequest()
    rclpy.init(args=ros_arguments, signal_handler_options=SignalHandlerOptions.NO)
    exchange = Exchange()
    try:
        points = load_scene(options.scene).held_points
        exchange.join_lane(os.environ, timed=True)
        with BagWriter(options.out, options.storage) as writer:
            node = RecorderNode(writer, points, exchange)
            failure = _record_until_done(node, exchange, stop, options)
            messages = node.messages
            # First, so that others do not count on who is about to leave.
            exchange.close()
            node.destroy_node()
        if failure:
            write_progress("failed", reason=failure)
            return 1
        write_progress("done", messages=messages)
        return 0
    except HapticMechError as error:
        write_progress("failed", reason=str(error))
        return 1
    finally:
        exchange.close()
        rclpy.try_shutdown()


def _record_until_done(
    node: RecorderNode, exchange: Exchange, stop: StopRequest, options: argparse.Namespace
) -> str | None:
    """Return None when all is recorded, or why not."""
    executor = EventsExecutor()
    executor.add_node(node)
    inbox = Inbox(executor, exchange)
    write_progress("ready")
    begun = time.monotonic()
    started = last_told = 0.0
    while rclpy.ok() and not stop.asked:
        inbox.gather()
        now = time.monotonic()
        if node.started_ns is None:
            node.start_hands_when_ready()
            if now - begun > options.start_timeout:
                silent = f"; nothing on {', '.join(node.silent())}" if node.silent() else ""
                return f"the hand did not start within {options.start_timeout:g} s{silent}"
            continue
        if not started:
            started = now
            write_progress("started")
        if now - last_told >= PROGRESS_PERIOD_S:
            last_told = now
            write_progress("progress", elapsed_s=min(now - started, options.duration))
        if now - started >= options.duration + TAIL_S:
            return None
    return "stopped by a signal before the experiment was over"


def _expected() -> list[Topic]:
    """Return the topics that a running graph publishes all the time."""
    return [t for t in TOPICS if t.publisher != "any" and t.rate in ("control", "view")]


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
