"""Somebody else who commands the device: servo_cf with empty stamps, at 1 kHz.

Usage: ``python foreign_commander.py NEWTON``. Tells ``first`` with the monotonic time of the first
command that somebody can hear.
"""

from __future__ import annotations

import sys
import time

from geometry_msgs.msg import WrenchStamped
from rclpy.node import Node

from hapticmech_ros.nodes.child import tell, watch
from hapticmech_ros.nodes.loop import wake_up_in_time
from hapticmech_ros.nodes.messages import WORLD
from hapticmech_ros.nodes.qos import STREAM_PUBLISHER
from hapticmech_ros.wire.topics import DEVICE_COMMAND

PERIOD_S = 0.001


class ForeignCommander(Node):
    """Pushes along x.

    Args:
        force: N.
    """

    def __init__(self, force: float) -> None:
        super().__init__("foreign_commander")
        self._told = False
        self._message = WrenchStamped()
        self._message.header.frame_id = WORLD
        self._message.wrench.force.x = force
        self._commands = self.create_publisher(WrenchStamped, DEVICE_COMMAND.name, STREAM_PUBLISHER)
        self.create_timer(PERIOD_S, self._publish)

    def _publish(self) -> None:
        if not self._told and self._commands.get_subscription_count():
            self._told = True
            tell("first", at_ns=time.monotonic_ns())
        self._commands.publish(self._message)


if __name__ == "__main__":
    wake_up_in_time()
    sys.exit(watch(lambda: ForeignCommander(float(sys.argv[1])), []))
