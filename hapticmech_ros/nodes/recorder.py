# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The recorder of an experiment: it starts waiting hands once it receives every topic of a graph.

Its parent reads its progress in lines of JSON on its standard output: ready, what it waits for
(twice a second), started (a hand pushes), progress, done or failed.
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
from rclpy.signals import SignalHandlerOptions
from std_srvs.srv import Trigger

from hapticmech_ros.bag.metadata import offered_qos
from hapticmech_ros.bag.storage import Messages
from hapticmech_ros.bag.writer import BagWriter
from hapticmech_ros.errors import HapticMechError
from hapticmech_ros.loading import load_scene
from hapticmech_ros.nodes.bags.bag_recorder import BagRecorderNode, RecordOptions
from hapticmech_ros.nodes.bags.recorded_topic import BagSpool
from hapticmech_ros.nodes.exchange import Exchange
from hapticmech_ros.nodes.loop import Inbox, StopRequest, prepare_to_gather, write_progress
from hapticmech_ros.nodes.messages import LATCHED, RECORDER_SUBSCRIBER
from hapticmech_ros.numerics.times import NANOSECONDS
from hapticmech_ros.wire.cdr import FlatArray
from hapticmech_ros.wire.messages import DeviceStateMessage
from hapticmech_ros.wire.topics import DEVICE_STATE, START_HAND, TOPICS, Topic, users_of

# Nodes publish diagnostics once a second: recording goes on this long, to include the last. The
# hands start once nothing is missing for so long: by then the graph's load is steady.
TAIL_S, SETTLE_S = 1.2, 2.2
PROGRESS_PERIOD_S = 0.1
# It may be behind by so long at the end.
MOST_BEHIND_S = 10.0
WAITING_PERIOD_S = 0.5
_HAND_WRENCH = DeviceStateMessage.layout.slice("hand_wrench")


class RecorderNode(BagRecorderNode):
    """Records the table's topics, and sees when the first hand starts.

    Args:
        spool: of the bag.
        options: of the recording.
        points: the operational points held.
        exchange: delivers messages from the lane.

    Attributes:
        started_ns: when the first hand started, ns of the machine's clock; None: not yet.
    """

    def __init__(
        self, spool: BagSpool, options: RecordOptions, points: Sequence[str], exchange: Exchange
    ) -> None:
        super().__init__(spool, options, exchange)
        users, full = users_of(points), self.resolve_topic_name
        self._expected = {full(topic.of(at, space)) for space, at in users for topic in _expected()}
        watched = {full(DEVICE_STATE.of(at, space)) for space, at in users}
        names = {full(topic.of(at, space)): topic for space, at in users for topic in TOPICS}
        for name, topic in names.items():
            # Before their publishers are there: to subscribe in a running graph takes long.
            request = LATCHED if topic.qos == "latched" else RECORDER_SUBSCRIBER
            received = self.receive(
                name, topic.type, self._look_at_device if name in watched else None
            )
            received.expect(request, offered_qos(topic.qos))
        self._decode = FlatArray(DeviceStateMessage.layout).decode
        self._start_hands = [
            self.create_client(Trigger, f"{space}/{START_HAND}" if space else START_HAND)
            for space, _ in users
        ]
        self._asked = False
        self._whole_s = 0.0
        self._newest_ns = 0
        self.started_ns: int | None = None

    def start_hands_when_ready(self) -> None:
        """Let the hands start once every topic of the graph is received, for :data:`SETTLE_S`."""
        now = time.monotonic()
        if self._asked or self.waits_for():
            self._whole_s = now
        elif now - self._whole_s >= SETTLE_S:
            self._asked = True
            # Messages from now on are the experiment's.
            for topic in self.received.values():
                topic.forget_losses()
            for client in self._start_hands:
                client.call_async(Trigger.Request())

    def waits_for(self) -> list[str]:
        """Return the topics from which nothing has come yet; then services that are not there."""
        received = {name for name, topic in self.received.items() if topic.count}
        return sorted(self._expected - received) or [
            client.srv_name for client in self._start_hands if not client.service_is_ready()
        ]

    @property
    def elapsed_s(self) -> float:
        """Time recorded since the first hand started, s: a busy machine's recorder is behind."""
        if self.started_ns is None:
            return 0.0
        return (self._newest_ns - self.started_ns) / NANOSECONDS

    def _look_at_device(self, messages: Messages) -> None:
        self._newest_ns = messages[-1][0]
        if self.started_ns is None:
            for time_ns, data in messages:
                if self._decode(bytes(data))[_HAND_WRENCH].any():
                    self.started_ns = time_ns
                    return


def main(arguments: Sequence[str]) -> int:
    """Record until the experiment is over, a signal, or a timeout; return the exit code."""
    parser = argparse.ArgumentParser(prog="recorder", description=__doc__)
    parser.add_argument("--out", type=Path, required=True, help="bag folder to make")
    parser.add_argument("--storage", choices=("mcap", "sqlite3"), default="mcap")
    parser.add_argument("--scene", required=True)
    parser.add_argument("--duration", type=float, required=True, help="s after the hand starts")
    parser.add_argument(
        "--start-timeout", type=float, default=30.0, help="s without anything new before the start"
    )
    options, ros_arguments = parser.parse_known_args(list(arguments))
    stop = StopRequest()
    rclpy.init(args=ros_arguments, signal_handler_options=SignalHandlerOptions.NO)
    exchange = Exchange()
    try:
        points = load_scene(options.scene).held_points
        exchange.join_lane(os.environ)
        spool = BagSpool(BagWriter(options.out, options.storage))
        try:
            recording = RecordOptions(options.out, storage=options.storage)
            node = RecorderNode(spool, recording, points, exchange)
            failure = _record_until_done(node, spool, exchange, stop, options)
            # First: other processes then expect no more from this one.
            exchange.close()
            node.finish()
            node.destroy_node()
        finally:
            spool.close()
        if failure:
            write_progress("failed", reason=failure)
            return 1
        write_progress("done", messages=sum(topic.count for topic in node.received.values()))
        return 0
    except HapticMechError as error:
        write_progress("failed", reason=str(error))
        return 1
    finally:
        exchange.close()
        rclpy.try_shutdown()


def _record_until_done(
    node: RecorderNode,
    spool: BagSpool,
    exchange: Exchange,
    stop: StopRequest,
    options: argparse.Namespace,
) -> str:
    """Return nothing when all is recorded, or why not."""
    executor = EventsExecutor()
    executor.add_node(node)
    prepare_to_gather()
    inbox = Inbox(executor, exchange)
    write_progress("ready")
    begun, started, reported, missing = time.monotonic(), 0.0, 0.0, None
    while rclpy.ok() and not stop.asked and not spool.failure:
        inbox.gather()
        now = time.monotonic()
        if node.started_ns is None:
            node.start_hands_when_ready()
            before, missing = missing, node.waits_for()
            if missing != before:
                begun = now
            if now - reported >= WAITING_PERIOD_S:
                reported = now
                write_progress("waiting", missing=missing)
            if now - begun > options.start_timeout:
                return _in_vain(missing, options.start_timeout)
            continue
        if not started:
            started = now
            write_progress("started")
        if now - reported >= PROGRESS_PERIOD_S:
            reported = now
            write_progress("progress", elapsed_s=min(node.elapsed_s, options.duration))
        end = options.duration + TAIL_S
        if node.elapsed_s >= end or now - started >= end + MOST_BEHIND_S:
            return ""
    return "stopped by a signal before the experiment was over"


def _in_vain(missing: Sequence[str], timeout_s: float) -> str:
    """Return a sentence on the missing topics or hand."""
    if missing:
        return f"for {timeout_s:g} s nothing came from {', '.join(missing)}"
    return f"the hand did not start within {timeout_s:g} s after the request"


def _expected() -> list[Topic]:
    """Return the topics that a running graph publishes all the time."""
    return [t for t in TOPICS if t.publisher != "any" and t.rate in ("control", "view")]


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
