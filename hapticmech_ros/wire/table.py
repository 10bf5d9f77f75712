# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The table of topics as Markdown; docs/topics.md holds it, and a test holds the two together."""

from __future__ import annotations

from hapticmech_ros.wire.topic import TEXT
from hapticmech_ros.wire.topics import TOPICS

RATES = {
    "control": "control rate (1 kHz)",
    "body": "control rate (1 kHz), with `device.servo_axes: body`",
    "view": "`view_rate` (100 Hz)",
    "shared": "`view_rate` (100 Hz), in scenes with several operational points",
    "contact": "`view_rate` (100 Hz), in scenes with contacts",
    "servo": "`view_rate` (100 Hz), while `servo_cp` or `hold` acts",
    "marker": "`marker_rate` (30 Hz)",
    "change": "on change",
    "1 Hz": "1 Hz",
    "caller's": "caller's",
}
PROFILES = {
    "stream": "reliable, keep last 10; nodes subscribe best effort, depth 5",
    "latched": "reliable, transient local, depth 1",
    "command": "subscribed best effort, depth 5",
}


def markdown() -> str:
    """Return one table row per topic of the graph."""
    lines = [
        "| topic | type | from | to | rate | QoS | meaning |",
        "|---|---|---|---|---|---|---|",
    ]
    for topic in TOPICS:
        # The table is the same wherever it is made.
        kind = TEXT if topic.type.startswith("crtk_msgs/") else topic.type
        readers = ", ".join(topic.subscribers) or "other nodes, bags"
        cells = (
            f"`{topic.name}`",
            kind.replace("/msg/", "/"),
            topic.publisher,
            readers,
            RATES[topic.rate],
            PROFILES[topic.qos],
            topic.meaning,
        )
        lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines) + "\n"
