"""A subscription that is made anew when one of its publishers has left.

Fast DDS goes on counting messages of a publisher that has left as unread, where a best-effort
reader keeps only the newest; and for each message that comes the executor looks for as many as are
unread (fastrtps 2.14 with rclpy's events executor). With each restart of a node those who hear it
would need more of a processor: three times as much after 24.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.subscription import Subscription

from hapticmech_ros.nodes.host import Host

# How often publishers are counted, s.
COUNTED_S = 0.25


class NodeInput:
    """A topic that an actor hears through the middleware, raw.

    Args:
        node: that subscribes.
        message_type: of the topic.
        name: of the topic.
        callback: gets messages as bytes.
        qos: of the subscription.
    """

    def __init__(
        self,
        node: Host,
        message_type: Any,
        name: str,
        callback: Callable[..., None],
        qos: QoSProfile,
    ) -> None:
        self._node = node
        self._recipe = message_type, name, callback, qos
        self._loses = qos.reliability == ReliabilityPolicy.BEST_EFFORT
        self._subscription = self._subscribe()
        self._publishers = 0

    @property
    def publishers(self) -> int:
        """How many publishers there are."""
        return int(self._subscription.get_publisher_count())

    def look(self) -> None:
        """Subscribe anew if there are fewer publishers than before.

        Messages of others may be missed for as long as these take to notice: whoever heard two
        publishers takes some time to trust one again.
        """
        publishers = self.publishers
        if publishers < self._publishers and self._loses:
            before, self._subscription = self._subscription, self._subscribe()
            self._node.drop(before)
        self._publishers = publishers

    def end(self) -> None:
        """Hear no more."""
        self._node.drop(self._subscription)

    def _subscribe(self) -> Subscription:
        made: Subscription = self._node.create_subscription(*self._recipe, raw=True)
        return self._node.keep(made)
