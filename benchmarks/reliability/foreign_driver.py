# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Somebody else's CRTK driver: publishes a device that stands still, and obeys servo_cf.

Tells ``first`` with the monotonic time of its first sample.
"""

from __future__ import annotations

import sys
import time

from geometry_msgs.msg import PoseStamped, TwistStamped, WrenchStamped
from rclpy.node import Node

from hapticmech_ros.nodes.loop import wake_up_in_time, watch, write_progress
from hapticmech_ros.nodes.messages import CONTROL_SUBSCRIBER, STREAM_PUBLISHER, WORLD
from hapticmech_ros.wire import topics

PERIOD_S = 0.001
# Somewhere else than the simulated device.
PLACE = (0.06, 0.02)


class ForeignDriver(Node):
    """Knows nothing but CRTK."""

    def __init__(self) -> None:
        super().__init__("foreign_driver")
        self._told = False
        self._messages = {
            topics.DEVICE_TWIST.name: TwistStamped(),
            topics.DEVICE_FORCE.name: WrenchStamped(),
            topics.HAND_FORCE.name: WrenchStamped(),
            # The pose comes last: a sample is whole with it.
            topics.DEVICE_POSE.name: PoseStamped(),
        }
        pose = self._messages[topics.DEVICE_POSE.name].pose
        pose.position.x, pose.position.y = PLACE
        self._publishers_of = {
            name: self.create_publisher(type(message), name, STREAM_PUBLISHER)
            for name, message in self._messages.items()
        }
        name = topics.DEVICE_COMMAND.name
        self.create_subscription(WrenchStamped, name, lambda command: None, CONTROL_SUBSCRIBER)
        self.create_timer(PERIOD_S, self._publish)

    def _publish(self) -> None:
        # A real driver's messages are heard only once somebody has met it.
        if not self._told and self._met():
            self._told = True
            write_progress("first", at_ns=time.monotonic_ns())
        stamp = self.get_clock().now().to_msg()
        for name, message in self._messages.items():
            message.header.stamp, message.header.frame_id = stamp, WORLD
            self._publishers_of[name].publish(message)

    def _met(self) -> bool:
        return any(one.get_subscription_count() for one in self._publishers_of.values())


if __name__ == "__main__":
    wake_up_in_time()
    sys.exit(watch(ForeignDriver, sys.argv[1:]))
