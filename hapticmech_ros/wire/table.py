# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The table of topics as Markdown; docs/topics.md holds it, and a test holds the two together.

Where the numbers of the graph's flat messages are, as a C++ header.
"""

from __future__ import annotations

from collections.abc import Iterator

from hapticmech_ros.layout import Layout
from hapticmech_ros.wire.energies import CONTROLLER_ENERGY_FIELDS, DEVICE_ENERGY_FIELDS
from hapticmech_ros.wire.layouts import (
    DEVICE_FIELDS,
    ENERGY_FIELDS,
    GAIN_FIELDS,
    OPERATIONAL_MODEL_FIELDS,
)
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


# Those that are the same in every scene, by topic; of ``mechanism/state`` the label tells.
FLAT_MESSAGES: dict[str, Layout] = {
    "device/state": DEVICE_FIELDS,
    "device/local_feedback_gain": GAIN_FIELDS,
    "device/energy": DEVICE_ENERGY_FIELDS,
    "analysis/<point>/operational_model": OPERATIONAL_MODEL_FIELDS,
    "controller/energy": CONTROLLER_ENERGY_FIELDS,
    "mechanism/energy": ENERGY_FIELDS,
}


def cpp_header() -> str:
    """Return the header: a namespace for each message, with its size and its fields' offsets."""
    return "\n".join(_lines()) + "\n"


def _lines() -> Iterator[str]:
    yield "// Offsets into the data of hapticmech_ros' std_msgs/Float64MultiArray messages."
    yield "// Made by: hapticmech topics --cpp"
    yield "#pragma once"
    yield "#include <cstddef>"
    yield ""
    yield "namespace hapticmech_ros {"
    for topic, fields in FLAT_MESSAGES.items():
        yield f"// {topic}"
        yield f"namespace {_name(topic)} {{"
        yield f"constexpr std::size_t size = {fields.size};"
        for name in fields:
            yield f"constexpr std::size_t {name} = {fields.start(name)};"
        yield "}"
    yield "}"


def _name(topic: str) -> str:
    first, *_, last = topic.split("/")
    return last if first == "analysis" else f"{first}_{last}"
