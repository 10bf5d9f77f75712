"""Tells its parent what the nodes of a graph say of themselves, a line of JSON for each status.

It subscribes to /diagnostics alone, a few messages a second: what it watches it hardly disturbs.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Sequence

import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.experimental import EventsExecutor
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions
from rclpy.utilities import get_rmw_implementation_identifier

from hapticmech_ros.nodes.messages import stamp_ns
from hapticmech_ros.nodes.qos import RECORDER_SUBSCRIBER
from hapticmech_ros.nodes.runtime import LONGEST_WAIT_S, StopRequest, wait_for_messages
from hapticmech_ros.wire.topics import DIAGNOSTICS


class GraphProbe(Node):
    """Prints every status that it hears."""

    def __init__(self) -> None:
        super().__init__("graph_probe")
        self.create_subscription(
            DiagnosticArray, DIAGNOSTICS.name, self._on_statuses, RECORDER_SUBSCRIBER
        )

    def _on_statuses(self, message: DiagnosticArray) -> None:
        for status in message.status:
            _tell(
                "status",
                node=status.name,
                stamp_ns=stamp_ns(message.header),
                message=status.message,
                figures={pair.key: pair.value for pair in status.values},
            )


def main(arguments: Sequence[str]) -> int:
    """Print statuses until a signal; return the exit code."""
    stop = StopRequest()
    rclpy.init(args=list(arguments), signal_handler_options=SignalHandlerOptions.NO)
    node = GraphProbe()
    executor = EventsExecutor()
    executor.add_node(node)
    _tell("ready", rmw=get_rmw_implementation_identifier())
    try:
        while rclpy.ok() and not stop.asked:
            wait_for_messages(executor, LONGEST_WAIT_S)
        return 0
    finally:
        node.destroy_node()
        rclpy.try_shutdown()


def _tell(event: str, **facts: object) -> None:
    print(json.dumps({"event": event, **facts}), flush=True)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
