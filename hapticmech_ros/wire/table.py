# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The table of topics as Markdown; docs/topics.md holds it, and a test holds the two together.

Where the numbers of the graph's flat messages are, as a C++ header.

An SROS2 policy of the graph grants each node its topics and services, by its tables.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from xml.etree import ElementTree

from hapticmech_ros.compilation.records import Layout
from hapticmech_ros.wire.messages import (
    ControllerEnergy,
    DeviceEnergy,
    DeviceStateMessage,
    LocalFeedbackGain,
    MechanismEnergy,
    OperationalModelMessage,
)
from hapticmech_ros.wire.topics import (
    ANALYSER,
    CLOSURES,
    CONTROLLER,
    DEVICE,
    DIAGNOSTICS,
    EMERGENCY_STOP,
    EXTERNAL_WRENCH,
    FOLLOWER,
    HAND_WRENCH,
    MECHANISM,
    PAGE,
    REAL_DEVICES,
    RELAY,
    ROBOT,
    SET_OPERATIONAL_POINT,
    START_HAND,
    TEXT,
    TOPICS,
    VIEWER,
)

NODES = (DEVICE, *REAL_DEVICES, MECHANISM, ANALYSER, CONTROLLER, FOLLOWER, ROBOT, VIEWER, PAGE)
# Of the relay, to the driver behind it: topics received and sent, by its parameters.
_BEHIND = ("/fd/joint_states", "/fd/fd_controller/commands")
# Of a robot, by the parameters of its nodes: joints and contact from it, commands to it.
_FROM_ROBOT, _TO_ROBOT = ("robot/joint_states", "robot/wrench"), ("robot/commands",)
# Beside the graph, each in a separate process.
ONLOOKERS = (FOLLOWER, ROBOT, VIEWER, PAGE)
# Four nodes in one process; and the operator, no node, who pushes, commands states and records.
COMPOSED, OPERATOR = "composed", "operator"
# Of every node.
_LOG = ("/rosout", "/parameter_events")
_OWN_SERVICES = (
    *("change_state", "get_state", "get_available_states", "get_available_transitions"),
    *("get_transition_graph", "describe_parameters", "get_parameter_types", "get_parameters"),
    *("list_parameters", "set_parameters", "set_parameters_atomically", "get_type_description"),
)
_SERVICES: Mapping[str, tuple[str, ...]] = {
    DEVICE: (EMERGENCY_STOP, START_HAND),
    **dict.fromkeys(REAL_DEVICES, (EMERGENCY_STOP,)),
    MECHANISM: (f"{CLOSURES.name}/*",),
}
# Topics with further ones below them: one for each publisher of pushes.
_PUSHES = (HAND_WRENCH, EXTERNAL_WRENCH)
# Prefixes of one user's device, analyser and controller.
_OF_A_USER = ("device/", "view/device/", "analysis/", f"{CONTROLLER}/")
# Of another package, published where it is installed.
_TF = ("/tf", "/tf_static")


def published(node: str) -> list[str]:
    """Return patterns of the topics that a node publishes; * stands for names of any length."""
    role = DEVICE if node in REAL_DEVICES else node
    own = [_pattern(t.name) for t in TOPICS if t.publisher == role]
    if node == PAGE:
        own = [*(f"{_pattern(topic.name)}/{PAGE}" for topic in _PUSHES)]
        own.append(_pattern(SET_OPERATIONAL_POINT.name))
    if node == RELAY:
        own.append(_BEHIND[1])
    if node == FOLLOWER:
        own += [*_TO_ROBOT, f"{_pattern(EXTERNAL_WRENCH.name)}/robot"]
    if node == ROBOT:
        own += _FROM_ROBOT
    managed = (DIAGNOSTICS.name, f"{node}/transition_event")
    return [*_LOG, *managed, *own, *(_TF if node == VIEWER else ())]


def subscribed(node: str) -> list[str]:
    """Return patterns of the topics that a node subscribes to."""
    found = ["/clock", "/parameter_events", *([DIAGNOSTICS.name] if node == PAGE else ())]
    role = DEVICE if node in REAL_DEVICES else node
    found += [_BEHIND[0]] if node == RELAY else []
    found += {FOLLOWER: _FROM_ROBOT, ROBOT: _TO_ROBOT}.get(node, ())
    for topic in TOPICS:
        # A real device is held by a hand, and has no simulated pushes.
        if role in topic.subscribers and not (role != node and topic is HAND_WRENCH):
            found.append(_pattern(topic.name))
            if topic in _PUSHES:
                found.append(f"{_pattern(topic.name)}/*")
    return found


def answered(node: str) -> list[str]:
    """Return patterns of the services that a node offers."""
    return [*(f"{node}/{name}" for name in _OWN_SERVICES), *_SERVICES.get(node, ())]


def requested(node: str) -> list[str]:
    """Return patterns of the services that a node calls."""
    return [f"{CLOSURES.name}/*", f"{CONTROLLER}/set_parameters"] if node == PAGE else []


def policy(namespace: str = "/", enclaves: str = "/hapticmech") -> str:
    """Return the policy as XML: an enclave for each process, and one for the operator's.

    Args:
        namespace: of the graph.
        enclaves: path that they are below.
    """
    root = ElementTree.Element("policy", version="0.2.0")
    processes = ElementTree.SubElement(root, "enclaves")
    nodes = {node: _of_a_node(node) for node in NODES}
    held = {node: {node: rules} for node, rules in nodes.items()}
    held[COMPOSED] = {node: rules for node, rules in nodes.items() if node not in ONLOOKERS}
    held[OPERATOR] = {OPERATOR: _of_the_operator()}
    for process, profiles in held.items():
        enclave = ElementTree.SubElement(processes, "enclave", path=f"{enclaves}/{process}")
        inside = ElementTree.SubElement(enclave, "profiles")
        for node, rules in profiles.items():
            profile = ElementTree.SubElement(inside, "profile", ns=namespace, node=node)
            for (kind, what), names in rules.items():
                allowed = ElementTree.SubElement(profile, kind, {what: "ALLOW"})
                for name in dict.fromkeys(names):
                    ElementTree.SubElement(allowed, kind[:-1]).text = name
    ElementTree.indent(root)
    return ElementTree.tostring(root, encoding="unicode") + "\n"


Rules = dict[tuple[str, str], list[str]]


def _of_a_node(node: str) -> Rules:
    rules: Rules = {
        ("services", "reply"): answered(node),
        ("services", "request"): requested(node),
        ("topics", "publish"): published(node),
        ("topics", "subscribe"): subscribed(node),
    }
    if node in (VIEWER, PAGE):
        # Of several users each has these in a separate namespace.
        for names in rules.values():
            names += [f"*/{name}" for name in names if name.startswith(_OF_A_USER)]
    return {rule: names for rule, names in rules.items() if names}


def _of_the_operator() -> Rules:
    """Return the operator's rules: to push, command states, record and call services."""
    pushed = [_pattern(topic.name) for topic in TOPICS if topic.publisher == "any"]
    pushed += [f"{_pattern(topic.name)}/*" for topic in _PUSHES]
    return {
        ("services", "reply"): [f"{OPERATOR}/{name}" for name in _OWN_SERVICES],
        ("services", "request"): [name for node in (*NODES, OPERATOR) for name in answered(node)],
        ("topics", "publish"): [*_LOG, *pushed],
        ("topics", "subscribe"): ["/clock", *_LOG, *(_pattern(t.name) for t in TOPICS), *_TF],
    }


def _pattern(name: str) -> str:
    return name.replace("{point}", "*")


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


# Those that are the same in every scene, by topic; for ``mechanism/state`` see its label.
FLAT_MESSAGES: dict[str, Layout] = {
    "device/state": DeviceStateMessage.layout,
    "device/local_feedback_gain": LocalFeedbackGain.layout,
    "device/energy": DeviceEnergy.layout,
    "analysis/<point>/operational_model": OperationalModelMessage.layout,
    "controller/energy": ControllerEnergy.layout,
    "mechanism/energy": MechanismEnergy.layout,
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
