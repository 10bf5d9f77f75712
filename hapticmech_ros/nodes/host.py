# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What an actor may ask of the node that hosts it."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Protocol, TypeVar

from hapticmech_ros.errors import HapticMechError
from hapticmech_ros.nodes.exchange import Exchange
from hapticmech_ros.nodes.pauses import OwnPauses
from hapticmech_ros.nodes.sources import Listener

E = TypeVar("E")


class Host(Protocol):
    """A ROS node that remembers what was made for its actor, and drops it on cleanup.

    What it has as an rclpy node has rclpy's types, which are none.

    Attributes:
        active: whether the actor acts.
        exchange: joins it with the other nodes of its process, and of its user's on this host.
        pauses: of its process.
    """

    active: bool
    exchange: Exchange
    pauses: OwnPauses

    @property
    def create_publisher(self) -> Any:
        """As of an rclpy node."""

    @property
    def create_subscription(self) -> Any:
        """As of an rclpy node."""

    @property
    def create_service(self) -> Any:
        """As of an rclpy node."""

    @property
    def create_client(self) -> Any:
        """As of an rclpy node."""

    @property
    def destroy_subscription(self) -> Any:
        """As of an rclpy node."""

    @property
    def resolve_topic_name(self) -> Any:
        """As of an rclpy node."""

    @property
    def get_topic_names_and_types(self) -> Any:
        """As of an rclpy node."""

    @property
    def count_publishers(self) -> Any:
        """As of an rclpy node."""

    @property
    def get_publishers_info_by_topic(self) -> Any:
        """As of an rclpy node."""

    @property
    def get_logger(self) -> Any:
        """As of an rclpy node."""

    def look_at_clock(self) -> None:
        """Begin anew if the machine's clock was set."""

    def now_ns(self) -> int:
        """Return the node's time, ns."""

    def keep(self, entity: E) -> E:
        """Remember a publisher, subscription or service until cleanup, and return it."""

    def drop(self, entity: object) -> None:
        """Destroy what is kept."""

    def lane_kind(self, message_type: Any) -> str:
        """Return what messages of a type are called on the lane; nothing: they do not go there."""

    def hand_over(
        self, topic: str, message_type: Any, listener: Listener
    ) -> Callable[[bytes], bool]:
        """Give a listener a topic's messages on this host until cleanup.

        Returns what tells of a message from the middleware whether it has been handed over.
        """

    def every(self, period_s: float, callback: Callable[[], None]) -> None:
        """Call back at a period of the machine's clock while the node is active."""

    def begin(self) -> None:
        """Activate if configured and inactive."""

    def end(self) -> None:
        """Deactivate if active."""

    def refuse(self, topic: str, error: HapticMechError) -> None:
        """Count a message that breaks a rule, and say so now and then."""
