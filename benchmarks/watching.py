# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A process of one node that looks on until a signal."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import rclpy
from rclpy.experimental import EventsExecutor
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions

from hapticmech_ros.nodes.loop import (
    LONGEST_WAIT_S,
    StopRequest,
    wait_for_messages,
    write_progress,
)


def watch(node_type: Callable[[], Node], arguments: Sequence[str], **facts: Any) -> int:
    """Run a node until a signal, and return the exit code.

    Args:
        node_type: creates the node, without arguments.
        arguments: for ROS.
        facts: printed with the event ``ready`` once the node is created.
    """
    stop = StopRequest()
    rclpy.init(args=list(arguments), signal_handler_options=SignalHandlerOptions.NO)
    node = node_type()
    executor = EventsExecutor()
    executor.add_node(node)
    write_progress("ready", **facts)
    try:
        while rclpy.ok() and not stop.asked:
            wait_for_messages(executor, LONGEST_WAIT_S)
        return 0
    finally:
        node.destroy_node()
        rclpy.try_shutdown()
