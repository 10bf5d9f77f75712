# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Somebody else, at 1 kHz: a CRTK driver, who commands the device, or who tells its gains.

``python -m benchmarks.reliability.foreigner driver`` publishes a device that stands still, and
obeys servo_cf; ``commander FX FY FZ TX TY TZ`` commands a constant wrench (N and N m) with empty
stamps, and without numbers holds the device where it is; ``gain`` tells it in local_feedback_gain
that it is very stiff, and that the mechanism has got much energy. Tells ``first`` whenever one more
can hear it, with the monotonic time of the first message to that one.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from geometry_msgs.msg import PoseStamped, TwistStamped, WrenchStamped
from rclpy.node import Node
from std_msgs.msg import Float64MultiArray

from benchmarks.watching import watch
from hapticmech_ros.nodes.loop import wake_up_in_time, write_progress
from hapticmech_ros.nodes.messages import CONTROL_SUBSCRIBER, STREAM_PUBLISHER, WORLD
from hapticmech_ros.wire import topics
from hapticmech_ros.wire.bounds import read
from hapticmech_ros.wire.cdr import decode
from hapticmech_ros.wire.messages import DeviceStateMessage, LocalFeedbackGain

PERIOD_S = 0.001
# m, where the driver's device is: somewhere else than the simulated one.
PLACE = (0.06, 0.02)
# Critically damped for the scene's device of 0.3 kg and 3e-4 kg m².
SPRING, DAMPER = np.repeat([120.0, 0.12], 3), np.repeat([12.0, 0.012], 3)
# N/m and N m/rad, a thousand times what the scene's device can bear; and J that nobody has given.
STIFFNESS, ENERGY = np.diag(np.repeat([1e6, 1e3], 3)), 1e3


class Foreigner(Node):
    """Publishes on topics that are somebody else's, and tells who can hear that.

    Args:
        name: of the node.
        kinds: of its messages, by topic.
    """

    def __init__(self, name: str, kinds: Mapping[str, Any]) -> None:
        super().__init__(name)
        self._heard_by = 0
        self._outlets = [
            self.create_publisher(kind, topic, STREAM_PUBLISHER) for topic, kind in kinds.items()
        ]
        # What is published, on each topic.
        self._messages = [kind() for kind in kinds.values()]
        self._timer = self.create_timer(PERIOD_S, self._publish)

    def _refresh(self) -> None:
        """Bring the messages up to date."""

    def _publish(self) -> None:
        heard_by = sum(one.get_subscription_count() for one in self._outlets)
        for _ in range(self._heard_by, heard_by):
            write_progress("first", at_ns=time.monotonic_ns())
        self._heard_by = max(self._heard_by, heard_by)
        self._refresh()
        for outlet, message in zip(self._outlets, self._messages, strict=True):
            outlet.publish(message)


class ForeignDriver(Foreigner):
    """A driver that knows nothing but CRTK; a sample is whole with its pose."""

    def __init__(self) -> None:
        kinds = {
            topics.DEVICE_TWIST.name: TwistStamped,
            topics.DEVICE_FORCE.name: WrenchStamped,
            topics.HAND_FORCE.name: WrenchStamped,
            topics.DEVICE_POSE.name: PoseStamped,
        }
        super().__init__("foreign_driver", kinds)
        place = self._messages[-1].pose.position
        place.x, place.y = PLACE
        self.create_subscription(
            WrenchStamped, topics.DEVICE_COMMAND.name, lambda command: None, CONTROL_SUBSCRIBER
        )

    def _refresh(self) -> None:
        stamp = self.get_clock().now().to_msg()
        for message in self._messages:
            message.header.stamp, message.header.frame_id = stamp, WORLD


class ForeignGain(Foreigner):
    """Tells the device how commands depend on it, and commands nothing."""

    def __init__(self) -> None:
        super().__init__("foreign_gain", {topics.DEVICE_GAIN.name: Float64MultiArray})
        self._model = np.concatenate((np.zeros(36), STIFFNESS.ravel(), np.zeros(36)))

    def _refresh(self) -> None:
        now = self.get_clock().now().nanoseconds
        gain = LocalFeedbackGain.answering(now, now, ENERGY, self._model)
        self._messages[0].data = gain.values.tolist()


class ForeignCommander(Foreigner):
    """Commands a constant wrench, or holds the device's position and lets it turn no further.

    Args:
        wrench: (6,) force and torque, N and N m, world axes; holds if empty.
    """

    def __init__(self, *wrench: float) -> None:
        super().__init__("foreign_commander", {topics.DEVICE_COMMAND.name: WrenchStamped})
        self._held: np.ndarray | None = None
        self._messages[0].header.frame_id = WORLD
        if wrench:
            self._fill(wrench)
        else:
            # It answers samples. With a timer as well, rclpy may let it be silent for a second.
            self._timer.cancel()
            self.create_subscription(
                Float64MultiArray,
                topics.DEVICE_STATE.name,
                self._hold,
                CONTROL_SUBSCRIBER,
                raw=True,
            )

    def _hold(self, message: bytes) -> None:
        measured = read(DeviceStateMessage, decode(message)).sample
        if self._held is None:
            self._held = measured.position.copy()
        away = np.concatenate((measured.position - self._held, np.zeros(3)))
        self._fill(-SPRING * away - DAMPER * measured.twist)
        self._publish()

    def _fill(self, wrench: Sequence[float] | np.ndarray) -> None:
        force, torque = self._messages[0].wrench.force, self._messages[0].wrench.torque
        force.x, force.y, force.z, torque.x, torque.y, torque.z = map(float, wrench)


KINDS = {"driver": ForeignDriver, "gain": ForeignGain, "commander": ForeignCommander}


if __name__ == "__main__":
    wake_up_in_time()
    sys.exit(watch(lambda: KINDS[sys.argv[1]](*map(float, sys.argv[2:])), []))
