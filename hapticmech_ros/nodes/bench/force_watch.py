"""Tells its parent when a device's actuators begin and cease to push, a line of JSON for each."""

from __future__ import annotations

import sys
from collections.abc import Sequence

import rclpy
from rclpy.experimental import EventsExecutor
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions
from std_msgs.msg import Float64MultiArray

from hapticmech_ros.nodes.qos import RECORDER_SUBSCRIBER
from hapticmech_ros.nodes.recorder import tell
from hapticmech_ros.nodes.runtime import LONGEST_WAIT_S, StopRequest, wait_for_messages
from hapticmech_ros.wire.cdr import decode
from hapticmech_ros.wire.layouts import unpack_device
from hapticmech_ros.wire.topics import DEVICE_STATE

# Longer than any stall that a device survives with its force on.
PAUSE_NS = 100_000_000


class ForceWatch(Node):
    """Looks at every sample of the device."""

    def __init__(self) -> None:
        super().__init__("force_watch")
        self._pushing = False
        self._last_ns = 0
        self.create_subscription(
            Float64MultiArray, DEVICE_STATE.name, self._look, RECORDER_SUBSCRIBER, raw=True
        )

    def _look(self, message: bytes) -> None:
        sample = unpack_device(decode(message))
        if self._pushing and sample.stamp_ns - self._last_ns > PAUSE_NS:
            # Another device, or one that was away: its force ended in between.
            self._pushing = False
            tell("off", stamp_ns=sample.stamp_ns)
        self._last_ns = sample.stamp_ns
        pushing = bool(sample.applied.any())
        if pushing != self._pushing:
            self._pushing = pushing
            tell("on" if pushing else "off", stamp_ns=sample.stamp_ns)


def main(arguments: Sequence[str]) -> int:
    """Watch until a signal; return the exit code."""
    stop = StopRequest()
    rclpy.init(args=list(arguments), signal_handler_options=SignalHandlerOptions.NO)
    node = ForceWatch()
    executor = EventsExecutor()
    executor.add_node(node)
    tell("ready")
    try:
        while rclpy.ok() and not stop.asked:
            wait_for_messages(executor, LONGEST_WAIT_S)
        return 0
    finally:
        node.destroy_node()
        rclpy.try_shutdown()


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
