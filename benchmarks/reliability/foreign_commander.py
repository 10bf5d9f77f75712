"""Somebody else who commands the device: servo_cf with empty stamps, at 1 kHz.

Usage: ``python foreign_commander.py FX FY FZ TX TY TZ`` commands a constant wrench (N and N m), and
without numbers holds the device where it is. Tells ``first`` whenever one more can hear it, with
the monotonic time of the first command to that one.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Sequence

import numpy as np
from geometry_msgs.msg import WrenchStamped
from rclpy.node import Node
from std_msgs.msg import Float64MultiArray

from hapticmech_ros.nodes.child import watch, write_progress
from hapticmech_ros.nodes.loop import wake_up_in_time
from hapticmech_ros.nodes.messages import WORLD
from hapticmech_ros.nodes.qos import CONTROL_SUBSCRIBER, STREAM_PUBLISHER
from hapticmech_ros.wire.cdr import decode
from hapticmech_ros.wire.layouts import unpack_device
from hapticmech_ros.wire.topics import DEVICE_COMMAND, DEVICE_STATE

PERIOD_S = 0.001
# Critically damped for the scene's device of 0.3 kg and 3e-4 kg m².
SPRING, DAMPER = np.repeat([120.0, 0.12], 3), np.repeat([12.0, 0.012], 3)


class ForeignCommander(Node):
    """Commands a constant wrench, or holds the device's position and lets it turn no further.

    Args:
        wrench: (6,) force and torque, N and N m, world axes; holds if empty.
    """

    def __init__(self, wrench: Sequence[float]) -> None:
        super().__init__("foreign_commander")
        self._heard_by = 0
        self._held: np.ndarray | None = None
        self._message = WrenchStamped()
        self._message.header.frame_id = WORLD
        self._commands = self.create_publisher(WrenchStamped, DEVICE_COMMAND.name, STREAM_PUBLISHER)
        if wrench:
            self._fill(wrench)
        else:
            self.create_subscription(
                Float64MultiArray, DEVICE_STATE.name, self._hold, CONTROL_SUBSCRIBER, raw=True
            )
        self.create_timer(PERIOD_S, self._publish)

    def _hold(self, message: bytes) -> None:
        measured = unpack_device(decode(message)).measured
        if self._held is None:
            self._held = measured.pose.translation.copy()
        away = np.concatenate((measured.pose.translation - self._held, np.zeros(3)))
        self._fill(-SPRING * away - DAMPER * measured.twist)

    def _fill(self, wrench: Sequence[float] | np.ndarray) -> None:
        force, torque = self._message.wrench.force, self._message.wrench.torque
        force.x, force.y, force.z, torque.x, torque.y, torque.z = map(float, wrench)

    def _publish(self) -> None:
        heard_by = self._commands.get_subscription_count()
        for _ in range(self._heard_by, heard_by):
            write_progress("first", at_ns=time.monotonic_ns())
        self._heard_by = max(self._heard_by, heard_by)
        self._commands.publish(self._message)


if __name__ == "__main__":
    wake_up_in_time()
    numbers = [float(number) for number in sys.argv[1:]]
    sys.exit(watch(lambda: ForeignCommander(numbers), []))
