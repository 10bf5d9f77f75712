"""An input whose publishers come and go still hears those that stay."""

from __future__ import annotations

import pytest
from rclpy.node import Node
from std_msgs.msg import Float64MultiArray

from hapticmech_ros.nodes.node_input import NodeInput
from hapticmech_ros.nodes.qos import CONTROL_SUBSCRIBER, STREAM_PUBLISHER
from ros.harness import Peer

pytestmark = pytest.mark.ros
TOPIC = "state"


class Keeper:
    """A node that keeps what is made, as nodes of this package do."""

    def __init__(self, node: Node) -> None:
        self.node = node
        self.create_subscription = node.create_subscription
        self.made: list[object] = []

    def keep(self, entity: object) -> object:
        self.made.append(entity)
        return entity

    def drop(self, entity: object) -> None:
        assert self.node.destroy_subscription(entity)


def test_the_one_that_stays_is_heard_after_the_other_has_left(domain: int) -> None:
    hears, stays, leaves = Peer(domain), Peer(domain), Peer(domain)
    try:
        keeper, heard = Keeper(hears.node), []
        found = NodeInput(keeper, Float64MultiArray, TOPIC, heard.append, CONTROL_SUBSCRIBER)
        one = stays.publisher(TOPIC, Float64MultiArray, STREAM_PUBLISHER)
        for round_number in range(3):
            other = leaves.publisher(TOPIC, Float64MultiArray, STREAM_PUBLISHER)
            hears.until(lambda: found.publishers == 2, "two publishers")
            found.look()
            other.publish(Float64MultiArray(data=[1.0]))
            leaves.node.destroy_publisher(other)
            hears.until(lambda: found.publishers == 1, "one publisher")
            found.look()
            found.look()
            assert len(keeper.made) == round_number + 2
            heard.clear()

            def told() -> bool:
                one.publish(Float64MultiArray(data=[2.0]))
                return bool(heard)

            hears.until(told, "the one that stays")
    finally:
        for peer in (hears, stays, leaves):
            peer.close()
