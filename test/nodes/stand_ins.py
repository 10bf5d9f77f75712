# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What stands for the middleware in tests without it, and a wait for what happens there."""

from __future__ import annotations

from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

from benchmarks.children import wait_until

# ns.
MS = 1_000_000


def at_last(
    happened: Callable[[], object],
    meanwhile: Callable[[], object] = lambda: None,
    within_s: float = 20.0,
) -> None:
    """Do something over and over until something has happened."""
    wait_until(happened, within_s, "what has to happen", meanwhile, look_again_s=0.0)


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
