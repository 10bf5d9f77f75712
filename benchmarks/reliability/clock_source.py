# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Publishes /clock at a given period, s: what this process takes for the time of day.

With the stepped clock in its environment it is a simulator's clock that jumps on command.
"""

from __future__ import annotations

import sys
import time
from functools import partial

from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from rosgraph_msgs.msg import Clock as ClockMessage

from benchmarks.watching import watch
from hapticmech_ros.nodes.loop import wake_up_in_time
from hapticmech_ros.numerics.times import NANOSECONDS


class ClockSource(Node):
    """Tells the time, at a pace of the monotonic clock.

    Args:
        period_s: s.
    """

    def __init__(self, period_s: float) -> None:
        super().__init__("clock_source")
        self._publisher = self.create_publisher(ClockMessage, "/clock", 10)
        self._message = ClockMessage()
        # A timer of its own clock would wait as long as that was set back.
        self.create_timer(period_s, self._tell, clock=Clock(clock_type=ClockType.STEADY_TIME))

    def _tell(self) -> None:
        stamp = self._message.clock
        stamp.sec, stamp.nanosec = divmod(time.time_ns(), NANOSECONDS)
        self._publisher.publish(self._message)


if __name__ == "__main__":
    wake_up_in_time()
    sys.exit(watch(partial(ClockSource, float(sys.argv[1])), sys.argv[2:]))
