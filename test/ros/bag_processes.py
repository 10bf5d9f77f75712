# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""``hapticmech bag`` in a process of its own, and a publisher in another."""

from __future__ import annotations

import sys
from contextlib import AbstractContextManager
from pathlib import Path
from subprocess import DEVNULL, PIPE, Popen

from ros.harness import program

_MAIN = "from hapticmech_ros.cli import main; main()"

# Publishes arrays with the fields stamp (2) and index (1), at an even rate, until it is stopped.
_PUBLISHER = """
import sys, time
import numpy as np, rclpy
from std_msgs.msg import Float64MultiArray
from hapticmech_ros.wire.cdr import FlatArray
topic, rate = sys.argv[1], float(sys.argv[2])
rclpy.init()
node = rclpy.create_node("steady_publisher")
publisher = node.create_publisher(Float64MultiArray, topic, 1000)
while publisher.get_subscription_count() == 0:
    time.sleep(0.01)
flat = FlatArray({"stamp": 2, "index": 1})
start, index = time.time(), 0
while True:
    stamp = divmod(time.time_ns(), 10**9)
    publisher.publish(flat.encode(np.array([*stamp, float(index)])))
    index += 1
    time.sleep(max(0.0, start + index / rate - time.time()))
"""


def bag_command(domain: int, *arguments: str | Path) -> AbstractContextManager[Popen[str]]:
    """Run ``hapticmech bag ...``, its output in a pipe; ended with the block at the latest."""
    command = sys.executable, "-c", _MAIN, "bag", *arguments
    return program(domain, *command, stdin=DEVNULL, stdout=PIPE)


def ended(process: Popen[str], *signals: int, within_s: float = 30.0) -> str:
    """Return what a command printed that ends well, by itself or by these signals."""
    for number in signals:
        process.send_signal(number)
    assert process.wait(within_s) == 0
    return process.stdout.read()


def steady_publisher(domain: int, topic: str, rate: float) -> AbstractContextManager[Popen[str]]:
    """Publish on a topic once somebody has subscribed to it."""
    return program(domain, sys.executable, "-c", _PUBLISHER, topic, str(rate), stdin=DEVNULL)
