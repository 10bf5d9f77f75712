# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The last messages of publishers that are about to be destroyed, which say that all is at zero."""

from __future__ import annotations

import time
from collections.abc import Iterable

from rclpy.duration import Duration
from rclpy.publisher import Publisher

# For all of them: a subscriber that stands still does not hold up a node's end.
WITHIN_S = 0.1


def wait_until_acknowledged(entities: Iterable[object], within_s: float = WITHIN_S) -> bool:
    """Wait until reliable subscribers have what publishers among the entities have sent.

    The end of a publisher is announced another way than its messages go: a subscriber that hears of
    it first drops what it has not received yet.

    Args:
        entities: of a node.
        within_s: how long to wait for all of them together, s.

    Returns:
        Whether all was acknowledged.
    """
    end = time.monotonic() + within_s
    well = True
    for entity in entities:
        if isinstance(entity, Publisher):
            left = max(0.0, end - time.monotonic())
            well = entity.wait_for_all_acked(Duration(seconds=left)) and well
    return well
