# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Quality of service of every topic, each with its reason."""

from __future__ import annotations

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
