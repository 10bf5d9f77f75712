# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What processes share that work for a parent: they tell it things, and run until a signal."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from typing import Any

import rclpy
from rclpy.experimental import EventsExecutor
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions

from hapticmech_ros.nodes.loop import LONGEST_WAIT_S, StopRequest, wait_for_messages


def write_progress(event: str, **facts: object) -> None:
    """Print a line of JSON for the parent process."""
    print(json.dumps({"event": event, **facts}), flush=True)


def watch(node_type: Callable[[], Node], arguments: Sequence[str], **facts: Any) -> int:
    """Run a node, which takes no arguments, until a signal; return the exit code.

    Args:
        node_type: of the node.
        arguments: for ROS.
        facts: told as soon as it listens.
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
