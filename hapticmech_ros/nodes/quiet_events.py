"""Publishers and subscriptions without callbacks for QoS events.

By default rclpy asks the middleware to tell of peers whose QoS or type does not fit, to log it.
Whoever takes such an event holds a lock of rmw_fastrtps and waits for one of Fast DDS, and the
thread that brings the next one does so the other way round: both may wait for ever (rmw_fastrtps
pull request 890, not in ROS 2 Jazzy's 8.4.3). The peer logs it too.
"""

from __future__ import annotations

from typing import Any

from rclpy.event_handler import PublisherEventCallbacks, SubscriptionEventCallbacks
from rclpy.node import Node


class QuietEventsNode(Node):
    """A node whose publishers and subscriptions are told of no QoS events unless that is wanted."""

    def create_publisher(self, *args: Any, **kwargs: Any) -> Any:
        """Create a publisher, as :meth:`rclpy.node.Node.create_publisher` does.

        Returns:
            The publisher.
        """
        kwargs.setdefault("event_callbacks", PublisherEventCallbacks(use_default_callbacks=False))
        return super().create_publisher(*args, **kwargs)

    def create_subscription(self, *args: Any, **kwargs: Any) -> Any:
        """Create a subscription, as :meth:`rclpy.node.Node.create_subscription` does.

        Returns:
            The subscription.
        """
        kwargs.setdefault(
            "event_callbacks", SubscriptionEventCallbacks(use_default_callbacks=False)
        )
        return super().create_subscription(*args, **kwargs)
