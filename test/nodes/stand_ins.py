# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What stands for the middleware in tests without it, and a wait for what happens there."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from types import SimpleNamespace
from typing import Any

import numpy as np
from geometry_msgs.msg import WrenchStamped
from rclpy.serialization import deserialize_message, serialize_message

from benchmarks.children import wait_until
from hapticmech_ros.nodes.messages import set_stamp
from hapticmech_ros.wire.bounds import read
from hapticmech_ros.wire.cdr import decode
from hapticmech_ros.wire.messages import DeviceStateMessage

# ns.
MS = 1_000_000


def at_last(
    happened: Callable[[], object],
    meanwhile: Callable[[], object] = lambda: None,
    within_s: float = 20.0,
) -> None:
    """Do something over and over until something has happened."""
    wait_until(happened, within_s, "what has to happen", meanwhile, look_again_s=0.0)


def heard(graph: Any, *topics: str) -> list[list[Any]]:
    """Return what a graph's actors send on topics from now on, as messages of their types."""
    found: dict[str, list[Any]] = {topic: [] for topic in topics}
    send = graph.sent

    def noted(topic: str, kind: Any, message: Any) -> None:
        if topic in found:
            told = deserialize_message(message, kind) if isinstance(message, bytes) else message
            found[topic].append(told)
        send(topic, kind, message)

    graph.sent = noted
    return list(found.values())


def say(graph: Any, topic: str, message: Any, frame: str = "world", late_s: float = 0.0) -> None:
    """Bring a message with a header, stamped now, to all who hear a topic of a graph."""
    message.header.frame_id = frame
    set_stamp(message.header.stamp, graph.now_ns - round(1e9 * late_s))
    graph.put(topic, serialize_message(message))


def push(
    graph: Any, topic: str, wrench: Sequence[float], frame: str = "world", late_s: float = 0.0
) -> None:
    """Bring a wrench (6,), stamped now, to all who hear a topic of a graph."""
    message = WrenchStamped()
    parts = message.wrench.force, message.wrench.torque
    for part, values in zip(parts, (wrench[:3], wrench[3:]), strict=True):
        part.x, part.y, part.z = map(float, values)
    say(graph, topic, message, frame, late_s)


def applied(graph: Any) -> np.ndarray:
    """Return what a graph's device applied by its last sample (6,), N and N m."""
    return last_sample(graph).applied.copy()


def last_sample(graph: Any) -> DeviceStateMessage:
    """Return what a graph's device told last."""
    return read(DeviceStateMessage, decode(graph.last["/device/state"]))


class Publisher:
    """Publishes into a list, to a given number of subscriptions."""

    def __init__(self, subscriptions: int = 1) -> None:
        self.subscriptions = subscriptions
        self.sent: list[Any] = []

    def publish(self, message: Any) -> None:
        self.sent.append(message)

    def get_subscription_count(self) -> int:
        return self.subscriptions


class Listed:
    """Knows publishers of every topic by name."""

    def __init__(self, *names: str) -> None:
        self.names = names

    def get_publishers_info_by_topic(self, topic: str) -> list[SimpleNamespace]:
        return [
            SimpleNamespace(
                node_namespace=name.rpartition("/")[0] or "/",
                node_name=name.rpartition("/")[2],
                endpoint_gid=bytes([0] * 15 + [index]),
            )
            for index, name in enumerate(self.names)
        ]
