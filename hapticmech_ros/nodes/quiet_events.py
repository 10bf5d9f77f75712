# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The package's kind of node: rclpy's, without two of its habits that stop or end a process.

By default rclpy asks the middleware to tell of peers whose QoS or type does not fit, to log it.
Whoever takes such an event holds a lock of rmw_fastrtps and waits for one of Fast DDS, and the
thread that brings the next one does so the other way round: both may wait for ever (rmw_fastrtps
pull request 890, not in ROS 2 Jazzy's 8.4.3). The peer logs it too.

An exception in a callback ends the process, also in those that are rclpy's own, which anybody may
send anything to: see :mod:`~hapticmech_ros.nodes.rclpy_callbacks`.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from functools import partial
from typing import Any

from rclpy.event_handler import PublisherEventCallbacks, SubscriptionEventCallbacks
from rclpy.node import Node

from hapticmech_ros.errors import HapticMechError
from hapticmech_ros.nodes.rclpy_callbacks import answering, is_rclpys, refusing
from hapticmech_ros.times import NANOSECONDS

# A refused message is logged at most this often for each topic.
REFUSAL_LOG_PERIOD_NS = NANOSECONDS


class QuietEventsNode(Node):
    """A node that is told of no QoS events, unless that is wanted, and that no message ends.

    Its own callbacks, other than rclpy's, are left as they are.
    """

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        self._refusal_logs: dict[str, int] = {}
        super().__init__(*args, **kwargs)
        # All that there are now, however they were made.
        for service in self.services:
            if is_rclpys(service.callback):
                what = f"request of {service.service_name}"
                service.callback = answering(service, partial(self.say_refused, what))

    def create_publisher(self, *args: Any, **kwargs: Any) -> Any:
        """Create a publisher, as :meth:`rclpy.node.Node.create_publisher` does.

        Returns:
            The publisher.
        """
        kwargs.setdefault("event_callbacks", PublisherEventCallbacks(use_default_callbacks=False))
        return super().create_publisher(*args, **kwargs)

    def create_subscription(
        self, msg_type: Any, topic: str, callback: Callable[..., None], *args: Any, **kwargs: Any
    ) -> Any:
        """Create a subscription, as :meth:`rclpy.node.Node.create_subscription` does.

        Returns:
            The subscription.
        """
        kwargs.setdefault(
            "event_callbacks", SubscriptionEventCallbacks(use_default_callbacks=False)
        )
        if is_rclpys(callback):
            callback = refusing(callback, partial(self.refuse, topic))
        return super().create_subscription(msg_type, topic, callback, *args, **kwargs)

    def refuse(self, topic: str, error: HapticMechError) -> None:
        """Drop a message that breaks a rule, and say so now and then."""
        self.say_refused(f"message on {topic}", error)

    def say_refused(self, what: str, error: HapticMechError) -> None:
        """Log what was refused, and why; at most once in :data:`REFUSAL_LOG_PERIOD_NS`."""
        now = time.monotonic_ns()
        last = self._refusal_logs.get(what)
        if last is None or now - last > REFUSAL_LOG_PERIOD_NS:
            self._refusal_logs[what] = now
            self.get_logger().warning(f"{what} refused: {error}")
