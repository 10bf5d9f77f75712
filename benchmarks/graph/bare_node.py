# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The bare graph: the same processes, topics, messages, rates and QoS, and nothing in between.

What the middleware and rclpy cost by themselves, for `python -m benchmarks graph`. Nodes have the
real ones' names and deadlines; a callback hands on the stamp of its message, and that is all.
Messages are those that the real nodes' actors send in this scene, each with a stamp put in.
"""

from __future__ import annotations

import struct
import sys
from collections.abc import Callable, Sequence
from typing import Any

import rclpy
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.serialization import deserialize_message
from rclpy.signals import SignalHandlerOptions
from std_msgs.msg import Float64MultiArray

from benchmarks.reliability.fake_graph import ACTORS, FakeGraph
from hapticmech_ros.loading import load_scene
from hapticmech_ros.nodes.loop import (
    StopRequest,
    prepare_loops,
    print_line,
    run_until,
    wake_up_in_time,
)
from hapticmech_ros.nodes.messages import (
    CONTROL_SUBSCRIBER,
    LATCHED,
    STREAM_PUBLISHER,
    message_class,
    set_stamp,
    stamp_ns,
)
from hapticmech_ros.nodes.node_time import DurationHistogram, NodeTime, PeriodClock
from hapticmech_ros.numerics.times import NANOSECONDS
from hapticmech_ros.wire.cdr import array_stamp, decode
from hapticmech_ros.wire.topics import (
    ANALYSER,
    ARRAY,
    CONTROLLER,
    DEVICE,
    DEVICE_COMMAND,
    DEVICE_STATE,
    DIAGNOSTICS,
    MECHANISM,
    STATE,
    TOPICS,
    Topic,
)

# Shares of a period by which the clocked nodes follow the common grid, as the real ones do.
PHASES = {DEVICE: 0.0, MECHANISM: 0.5}
# What the other nodes answer, each message with one on every control topic of theirs.
QUESTIONS = {ANALYSER: STATE, CONTROLLER: DEVICE_STATE}
# A message older than this is not heard any more; says no more than diagnostics' first word.
SILENCE_NS = NANOSECONDS // 4
# s of the scene in which the actors engage, and send every message that is published.
ENGAGES_S = 0.3
# What is published at a time, ns: a message, or one already serialized.
Example = Callable[[int], Any]


class BareNode(Node):
    """A node of the bare graph; its topics are those that the table gives to ``name``."""

    ends_forces = False

    def __init__(self, name: str) -> None:
        super().__init__(name)
        self._time = NodeTime()
        self._scene_name = str(self.declare_parameter("scene", "five_bar").value)
        view_rate = float(self.declare_parameter("view_rate", 100.0).value)
        period_s = float(self.declare_parameter("diagnostics_period", 1.0).value)
        scene = load_scene(self._scene_name)
        self._period_s = scene.simulation.period
        self._view_every = max(1, round(1.0 / (view_rate * self._period_s)))
        self._points = [point.name for point in scene.operational_points]
        actors = FakeGraph(self._scene_name, actors=ACTORS[:4])
        actors.run(ENGAGES_S)
        self._sent = actors.last
        self._said = 0
        self._received_ns = 0
        self._ages, self._latency = DurationHistogram(), DurationHistogram()
        self._control = self._outputs_at("control")
        self._view = self._outputs_at("view")
        for topic in TOPICS:
            for heard in self._names(topic) if name in topic.subscribers else ():
                kind, raw = message_class(topic.type), topic.type == ARRAY
                self.create_subscription(
                    kind, heard, self._hearer(topic), CONTROL_SUBSCRIBER, raw=raw
                )
        self._say(self._outputs_at("change"), 0)
        self._diagnostics = self.create_publisher(
            DiagnosticArray, DIAGNOSTICS.name, STREAM_PUBLISHER
        )
        self.create_timer(period_s, self._publish_diagnostics)
        self._deadlines: PeriodClock | None = None
        if name in PHASES:
            self._deadlines = PeriodClock.on_grid(self._period_s, PHASES[name], self.now_ns())

    def look_at_clock(self) -> None:
        """Leave the machine's clock alone."""

    def now_ns(self) -> int:
        """Return the node's time, ns."""
        return self._time.now_ns()

    def next_deadline_ns(self) -> int | None:
        """Return when the node wants to publish next; None: only when asked."""
        return None if self._deadlines is None else self._deadlines.next_ns

    def act(self, now_ns: int) -> None:
        """Publish a sample if a deadline has come."""
        clock = self._deadlines
        if clock is not None and clock.due(now_ns):
            self._say_sample(clock.last_deadline_ns)

    def final_report(self) -> str:
        """Return what is printed when the node ends."""
        shown = ", ".join(f"{key} {value}" for key, value in self._figures().items())
        return f"bare {self.get_name()}: {shown}"

    def _names(self, topic: Topic) -> list[str]:
        """Return a topic's name, or the mechanism's for each operational point."""
        points = self._points if self.get_name() == MECHANISM else self._points[:1]
        return list(dict.fromkeys(topic.of(point) for point in points))

    def _outputs_at(self, rate: str) -> list[tuple[Publisher, Example]]:
        qos = STREAM_PUBLISHER, LATCHED
        return [
            (
                self.create_publisher(message_class(topic.type), name, qos[topic.qos == "latched"]),
                example(message_class(topic.type), self._sent.get(f"/{name}")),
            )
            for topic in TOPICS
            if topic.publisher == self.get_name() and topic.rate == rate
            for name in self._names(topic)
        ]

    def _hearer(self, topic: Topic) -> Callable[[Any], None]:
        raw = topic.type == ARRAY
        if topic.rate != "control":
            return lambda message: None
        answers = QUESTIONS.get(self.get_name()) == topic
        closes_loop = topic == DEVICE_COMMAND

        def receive(message: Any) -> None:
            now, stamp = self.now_ns(), array_stamp(message) if raw else stamp_ns(message.header)
            self._ages.add(now - stamp)
            self._received_ns = now
            if closes_loop:
                self._latency.add(now - stamp)
            if answers:
                self._say_sample(stamp)

        return receive

    def _say_sample(self, time_ns: int) -> None:
        self._say(self._control, time_ns)
        if self._said % self._view_every == 0:
            self._say(self._view, time_ns)
        self._said += 1

    def _say(self, publishers: Sequence[tuple[Publisher, Example]], time_ns: int) -> None:
        for publisher, example in publishers:
            publisher.publish(example(time_ns))

    def _figures(self) -> dict[str, str]:
        figures: dict[str, str] = {}
        if (clock := self._deadlines) is not None:
            share = (clock.periods - clock.missed) / clock.periods if clock.periods else 1.0
            figures |= {
                "periods": str(clock.periods),
                "missed_deadlines": str(clock.missed),
                "dropped_periods": "0",
                "achieved_rate_hz": f"{share / self._period_s:.1f}",
            }
        if self.get_name() == DEVICE:
            figures |= self._latency.summary("loop_latency")
        if self.get_name() == ANALYSER:
            figures["analyses"] = str(self._said)
        if self.get_name() == CONTROLLER:
            figures |= {"answers": str(self._said), "engagements": "1"}
        return {**figures, **self._ages.summary("message_age"), "refused_messages": "0"}

    def _publish_diagnostics(self) -> None:
        received = self.now_ns() - self._received_ns < SILENCE_NS
        status = DiagnosticStatus(
            level=DiagnosticStatus.OK if received else DiagnosticStatus.WARN,
            name=self.get_name(),
            message="engaged" if received else "waiting for messages",
            hardware_id=self._scene_name,
            values=[KeyValue(key=key, value=value) for key, value in self._figures().items()],
        )
        message = DiagnosticArray(status=[status])
        set_stamp(message.header.stamp, self.now_ns())
        self._diagnostics.publish(message)


def run(names: Sequence[str], arguments: Sequence[str]) -> None:
    """Run the named nodes of the bare graph in this thread until a signal."""
    stop = StopRequest()
    wake_up_in_time()
    rclpy.init(args=list(arguments), signal_handler_options=SignalHandlerOptions.NO)
    nodes = [BareNode(name) for name in names]
    try:
        run_until(stop, nodes, begun=prepare_loops)
        for node in nodes:
            print_line(node.final_report())
    finally:
        for node in nodes:
            node.destroy_node()
        rclpy.try_shutdown()


def example(kind: Any, sent: Any) -> Example:
    """Return what publishes a message again and again, with the stamp of the time, if it has one.

    Args:
        kind: its type.
        sent: message or bytes; None: an empty one.
    """
    message = deserialize_message(sent, kind) if isinstance(sent, bytes) else sent or kind()
    if hasattr(message, "header"):

        def at(stamp_ns: int) -> Any:
            set_stamp(message.header.stamp, stamp_ns)
            return message

        return at
    # Flat arrays have one dimension and begin with their stamp; matrices have two and none.
    if kind is Float64MultiArray and len(message.layout.dim) == 1:
        written = bytearray(sent)
        offset = len(sent) - decode(sent).nbytes

        def encoded_at(stamp_ns: int) -> bytes:
            struct.pack_into("<dd", written, offset, *divmod(stamp_ns, NANOSECONDS))
            return bytes(written)

        return encoded_at
    return lambda stamp_ns: message


if __name__ == "__main__":
    # python -m benchmarks.graph.bare_node NAME[,NAME...] [--ros-args ...]
    run(sys.argv[1].split(","), sys.argv[2:])
