# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""How long an ordinary program takes, beside a graph, from its start until it has read a message.

As `ros2 topic echo`, an emergency stop or a recorder does: it imports rclpy, joins and subscribes.
"""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path

from benchmarks.children import BenchError, next_line, output_to
from benchmarks.small_machine.demo_run import SCENE, hapticmech
from hapticmech_ros.graph.processes import start_process, stop_process

PROGRAM = """
import rclpy
from {package}.msg import {kind}
rclpy.init()
node = rclpy.create_node("reader")
heard = []
node.create_subscription({kind}, "{topic}", heard.append, 10)
while not heard:
    rclpy.spin_once(node)
print("read", flush=True)
"""
READS = PROGRAM.format(package="std_msgs", kind="Float64MultiArray", topic="/device/state")
# The device speaks first; commands come once all of the graph has started.
WAITS = PROGRAM.format(package="geometry_msgs", kind="WrenchStamped", topic="/device/servo_cf")
# Turns a command into one that runs within a load.
Within = Callable[[Sequence[str]], Sequence[str]]
# s that the first one may take, which waits for the graph, and that each of the others may.
PATIENCE_S = 60.0


def read_beside(rate_hz: float, within: Within, count: int, log: Path) -> tuple[float, ...]:
    """Return the times of programs that are started one after the other beside a graph, s.

    Args:
        rate_hz: control rate of the graph.
        within: turns the command of the graph, and of the programs, into one under a load.
        count: of programs.
        log: file for what the graph prints.

    Raises:
        BenchError: one of them has read nothing in time.
    """
    command = [hapticmech(), "run", SCENE, "--control-rate", f"{rate_hz:g}"]
    with output_to(log):
        graph = start_process(within(command), os.environ)
    try:
        # Not counted: it waits for the graph.
        _read(within, WAITS)
        return tuple(_read(within, READS) for _ in range(count))
    finally:
        stop_process(graph)


def _read(within: Within, code: str) -> float:
    begun = time.monotonic()
    program = start_process(within([sys.executable, "-c", code]), os.environ, pipe_output=True)
    try:
        if not next_line(program, PATIENCE_S):
            raise BenchError(f"a program beside the graph read nothing in {PATIENCE_S:g} s")
        return time.monotonic() - begun
    finally:
        program.kill()
        program.communicate()
