# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Topics of a bag that the experiment needs, with their full names."""

from __future__ import annotations

from hapticmech_ros.bag import BagReader
from hapticmech_ros.bag.former_topics import refuse_former_topics
from hapticmech_ros.errors import BagError
from hapticmech_ros.wire.topic import Topic
from hapticmech_ros.wire.topics import (
    CONSTRAINT_PART,
    DEVICE_STATE,
    ENERGY,
    JOINT_STATES,
    POINT_COMMAND,
    POINT_FORCE,
    POINT_MODEL,
)

NEEDED = (DEVICE_STATE, POINT_MODEL, CONSTRAINT_PART, ENERGY)
# Needed where several users hold one mechanism, of each.
SHARED = (POINT_COMMAND, POINT_FORCE)
# Needed only for the drawing of the mechanism.
WELCOME = (JOINT_STATES,)


def full_name(topic: Topic, point: str, namespace: str = "", user: str = "") -> str:
    """Return the absolute name of a topic of a graph.

    Args:
        topic: of it.
        point: operational point.
        namespace: that the graph runs under.
        user: namespace of one of several users within it.
    """
    name = topic.of(point, user)
    if name.startswith("/"):
        return name
    prefix = namespace.strip("/")
    return f"/{prefix}/{name}" if prefix else f"/{name}"


def chosen_topics(bag: BagReader, point: str, namespace: str, user: str = "") -> dict[Topic, str]:
    """Return the topics to read and their full names in ``bag``.

    Args:
        bag: to read.
        point: operational point that the user holds.
        namespace: of the graph.
        user: namespace of one of several users; empty of one alone.

    Raises:
        BagError: topics missing, empty, of another type or under a former name; the message lists
            all of them.
    """
    refuse_former_topics(bag)
    needed = NEEDED + SHARED if user else NEEDED
    names = {topic: full_name(topic, point, namespace, user) for topic in needed}
    missing = [name for name in names.values() if name not in bag.topics]
    empty = [n for n in names.values() if n in bag.topics and bag.topics[n].count == 0]
    other = [
        f"{name} (is {bag.topics[name].type}, should be {topic.type})"
        for topic, name in names.items()
        if name in bag.topics and bag.topics[name].type != topic.type
    ]
    complaints = [
        f"{what}: {', '.join(which)}"
        for what, which in (
            ("missing topics", missing),
            ("topics without messages", empty),
            ("topics of another type", other),
        )
        if which
    ]
    if complaints:
        hint = _namespace_hint(bag, missing, f"{namespace}/{user}")
        raise BagError(f"bag {bag.path}: {'; '.join(complaints)}{hint}")
    for topic in WELCOME:
        name = full_name(topic, point, namespace, user)
        if name in bag.topics and bag.topics[name].type == topic.type:
            names[topic] = name
    return names


def _namespace_hint(bag: BagReader, missing: list[str], namespace: str) -> str:
    """Return a hint if the bag has the device's state under another namespace."""
    if not missing:
        return ""
    ending = f"/{DEVICE_STATE.name}"
    found = [name.removesuffix(ending) or "/" for name in bag.topics if name.endswith(ending)]
    other = [place for place in found if place.strip("/") != namespace.strip("/")]
    return f" (the bag has the namespace {', '.join(other)})" if other else ""
