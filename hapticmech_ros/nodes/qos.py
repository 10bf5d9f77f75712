# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Quality of service of every topic, each with its reason; and waiting for what is reliable."""

from __future__ import annotations

import time
from collections.abc import Iterable

from rclpy.duration import Duration
from rclpy.publisher import Publisher
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy

# Publishers are reliable: a reliable subscriber (CRTK clients, bags, `ros2 topic`) would silently
# not match a best-effort publisher. A few samples of history ride out a reader's hiccup.
STREAM_PUBLISHER = QoSProfile(
    history=HistoryPolicy.KEEP_LAST, depth=10, reliability=ReliabilityPolicy.RELIABLE
)
# The control path never waits for a lost sample, and wants new ones. Not the newest alone: of a
# publisher that leaves, Fast DDS 2.14 goes on counting messages as unread that newer ones replaced,
# and for each message that comes rclpy's events executor looks for as many as are unread. With a
# history of 1 the analyser took three times as much of a processor after 24 restarts of a second
# mechanism; with 5 it does not.
CONTROL_SUBSCRIBER = QoSProfile(
    history=HistoryPolicy.KEEP_LAST, depth=5, reliability=ReliabilityPolicy.BEST_EFFORT
)
# Commands of other people's nodes: best effort connects to reliable and best-effort publishers.
COMMAND_SUBSCRIBER = CONTROL_SUBSCRIBER
# State that changes rarely: whoever comes late gets the last value.
LATCHED = QoSProfile(
    history=HistoryPolicy.KEEP_LAST,
    depth=1,
    reliability=ReliabilityPolicy.RELIABLE,
    durability=DurabilityPolicy.TRANSIENT_LOCAL,
)
# In lockstep nothing of the control path may be lost, not even what was said before the reader was
# discovered; at most two samples are ever on their way.
LOCKSTEP = QoSProfile(
    history=HistoryPolicy.KEEP_LAST,
    depth=10,
    reliability=ReliabilityPolicy.RELIABLE,
    durability=DurabilityPolicy.TRANSIENT_LOCAL,
)
# Recording loses nothing that arrives.
RECORDER_SUBSCRIBER = QoSProfile(
    history=HistoryPolicy.KEEP_LAST, depth=1000, reliability=ReliabilityPolicy.RELIABLE
)


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
