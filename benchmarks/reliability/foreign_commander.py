# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Somebody else who commands the device, at 1 kHz: servo_cf with empty stamps, or gains alone.

Usage: ``python foreign_commander.py FX FY FZ TX TY TZ`` commands a constant wrench (N and N m), and
without numbers holds the device where it is; ``python foreign_commander.py gain`` tells it in
local_feedback_gain that it is very stiff, and that the mechanism has got much energy. Tells
``first`` whenever one more can hear it, with the monotonic time of the first message to that one.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Sequence
from typing import Any

import numpy as np
from geometry_msgs.msg import WrenchStamped
from rclpy.node import Node
from std_msgs.msg import Float64MultiArray

from hapticmech_ros.nodes.loop import wake_up_in_time, watch, write_progress
from hapticmech_ros.nodes.messages import CONTROL_SUBSCRIBER, STREAM_PUBLISHER, WORLD
from hapticmech_ros.wire.bounds import read
from hapticmech_ros.wire.cdr import decode
from hapticmech_ros.wire.messages import DeviceStateMessage, LocalFeedbackGain
from hapticmech_ros.wire.topics import DEVICE_COMMAND, DEVICE_GAIN, DEVICE_STATE, Topic

PERIOD_S = 0.001
# Critically damped for the scene's device of 0.3 kg and 3e-4 kg m².
SPRING, DAMPER = np.repeat([120.0, 0.12], 3), np.repeat([12.0, 0.012], 3)
# N/m and N m/rad, a thousand times what the scene's device can bear; and J that nobody has given.
STIFFNESS, ENERGY = np.diag(np.repeat([1e6, 1e3], 3)), 1e3


class ForeignPublisher(Node):
    """Publishes on a topic of the device's, and tells who can hear that.

    Args:
        name: of the node.
        kind: of its messages.
        topic: on which.
    """

    def __init__(self, name: str, kind: Any, topic: Topic) -> None:
        super().__init__(name)
        self._heard_by = 0
        self._publisher = self.create_publisher(kind, topic.name, STREAM_PUBLISHER)
        self.create_timer(PERIOD_S, self._publish)

    def _next(self) -> Any:
        """Return what is published now."""
        raise NotImplementedError

    def _publish(self) -> None:
        heard_by = self._publisher.get_subscription_count()
        for _ in range(self._heard_by, heard_by):
            write_progress("first", at_ns=time.monotonic_ns())
        self._heard_by = max(self._heard_by, heard_by)
        self._publisher.publish(self._next())


class ForeignGain(ForeignPublisher):
    """Tells the device how commands depend on it, and commands nothing."""

    def __init__(self) -> None:
        super().__init__("foreign_gain", Float64MultiArray, DEVICE_GAIN)
        self._model = np.concatenate((np.zeros(36), STIFFNESS.ravel(), np.zeros(36)))

    def _next(self) -> Float64MultiArray:
        now = self.get_clock().now().nanoseconds
        gain = LocalFeedbackGain.answering(now, now, ENERGY, self._model)
        return Float64MultiArray(data=gain.values.tolist())


class ForeignCommander(ForeignPublisher):
    """Commands a constant wrench, or holds the device's position and lets it turn no further.

    Args:
        wrench: (6,) force and torque, N and N m, world axes; holds if empty.
    """

    def __init__(self, wrench: Sequence[float]) -> None:
        super().__init__("foreign_commander", WrenchStamped, DEVICE_COMMAND)
        self._held: np.ndarray | None = None
        self._message = WrenchStamped()
        self._message.header.frame_id = WORLD
        if wrench:
            self._fill(wrench)
        else:
            self.create_subscription(
                Float64MultiArray, DEVICE_STATE.name, self._hold, CONTROL_SUBSCRIBER, raw=True
            )

    def _hold(self, message: bytes) -> None:
        measured = read(DeviceStateMessage, decode(message)).sample
        if self._held is None:
            self._held = measured.position.copy()
        away = np.concatenate((measured.position - self._held, np.zeros(3)))
        self._fill(-SPRING * away - DAMPER * measured.twist)

    def _fill(self, wrench: Sequence[float] | np.ndarray) -> None:
        force, torque = self._message.wrench.force, self._message.wrench.torque
        force.x, force.y, force.z, torque.x, torque.y, torque.z = map(float, wrench)

    def _next(self) -> WrenchStamped:
        return self._message


def foreigner(arguments: Sequence[str]) -> ForeignPublisher:
    """Return the node that arguments ask for."""
    if arguments == ["gain"]:
        return ForeignGain()
    return ForeignCommander([float(number) for number in arguments])


if __name__ == "__main__":
    wake_up_in_time()
    sys.exit(watch(lambda: foreigner(sys.argv[1:]), []))
