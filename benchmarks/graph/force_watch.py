"""Tells its parent when a device's actuators begin and cease to push, a line of JSON for each."""

from __future__ import annotations

import sys

from rclpy.node import Node
from std_msgs.msg import Float64MultiArray

from hapticmech_ros.nodes.child import tell, watch
from hapticmech_ros.nodes.qos import RECORDER_SUBSCRIBER
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


if __name__ == "__main__":
    sys.exit(watch(ForceWatch, sys.argv[1:]))
