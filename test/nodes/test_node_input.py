"""A subscription is made anew when one of its publishers has left."""

from __future__ import annotations

from typing import Any

import pytest

pytest.importorskip("rclpy")

from std_msgs.msg import Float64MultiArray

from hapticmech_ros.nodes.node_input import NodeInput
from hapticmech_ros.nodes.qos import CONTROL_SUBSCRIBER, LOCKSTEP


class Subscribed:
    def __init__(self, publishers: int) -> None:
        self.publishers = publishers

    def get_publisher_count(self) -> int:
        return self.publishers


class Node:
    """Makes subscriptions, and remembers which of them there are."""

    def __init__(self) -> None:
        self.publishers = 0
        self.made: list[Subscribed] = []
        self.kept: list[Subscribed] = []

    def create_subscription(self, *given: Any, raw: bool) -> Subscribed:
        assert raw
        self.made.append(Subscribed(self.publishers))
        return self.made[-1]

    def keep(self, entity: Subscribed) -> Subscribed:
        self.kept.append(entity)
        return entity

    def drop(self, entity: Subscribed) -> None:
        self.kept.remove(entity)

    def count(self, publishers: int) -> None:
        self.publishers = publishers
        for one in self.kept:
            one.publishers = publishers


@pytest.mark.parametrize("qos", [CONTROL_SUBSCRIBER, LOCKSTEP])
def test_it_is_made_anew_once_for_each_publisher_that_left(qos: Any) -> None:
    node = Node()
    found = NodeInput(node, Float64MultiArray, "state", lambda message: None, qos)
    for publishers, made in ((1, 1), (2, 1), (1, 2), (1, 2), (2, 2), (0, 3), (1, 3)):
        node.count(publishers)
        found.look()
        assert found.publishers == publishers
        # What is reliable keeps all of its messages.
        assert len(node.made) == (made if qos is CONTROL_SUBSCRIBER else 1)
        assert node.kept == node.made[-1:]
    found.end()
    assert not node.kept
