# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Tells its parent what the nodes of a graph say of themselves, a line of JSON for each status.

It subscribes to /diagnostics alone, a few messages a second: what it watches it hardly disturbs.
"""

from __future__ import annotations

import sys

from diagnostic_msgs.msg import DiagnosticArray
from rclpy.node import Node

from benchmarks.watching import watch
from hapticmech_ros.nodes.loop import write_progress
from hapticmech_ros.nodes.messages import RECORDER_SUBSCRIBER, stamp_ns
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
            write_progress(
                "status",
                node=status.name,
                stamp_ns=stamp_ns(message.header),
                message=status.message,
                figures={pair.key: pair.value for pair in status.values},
            )


if __name__ == "__main__":
    sys.exit(watch(GraphProbe, sys.argv[1:]))
