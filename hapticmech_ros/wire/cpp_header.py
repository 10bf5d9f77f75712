# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Where the numbers of the graph's flat messages are, as a C++ header."""

from __future__ import annotations

from collections.abc import Iterator

from hapticmech_ros.layout import Layout
from hapticmech_ros.wire.energies import CONTROLLER_ENERGY_FIELDS, DEVICE_ENERGY_FIELDS
from hapticmech_ros.wire.gain_wire import GAIN_FIELDS
from hapticmech_ros.wire.layouts import DEVICE_FIELDS, ENERGY_FIELDS, OPERATIONAL_MODEL_FIELDS

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
