# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The policy for SROS2 against a running graph: what nodes do is allowed, and is all there is."""

from __future__ import annotations

import contextlib
from collections.abc import Callable
from fnmatch import fnmatchcase
from typing import Any

import pytest
from visualization_msgs.msg import MarkerArray

from hapticmech_ros.bag.check import OPTIONAL
from hapticmech_ros.wire.policy import answered, heard, published
from hapticmech_ros.wire.topics import DEVICE_BODY_FORCE, TOPICS
from ros.harness import Peer, running

pytestmark = pytest.mark.ros
NODES = (
    *("haptic_device", "mechanism_simulator", "nullspace_analyser", "teleoperation_controller"),
    "scene_viewer",
)
# Of what is not in every graph: contacts, drivers with axes of their own, tf2's messages.
SOME = {t.name.replace("{point}", "*") for t in TOPICS if t.rate in OPTIONAL}
SOME |= {DEVICE_BODY_FORCE.name} | {"/tf", "/tf_static", "/clock", "/parameter_events"}


def _names(found: list[tuple[str, list[str]]]) -> set[str]:
    return {name for name, _ in found}


def _patterns(rules: list[str]) -> dict[str, str]:
    return {rule: rule if rule.startswith("/") else f"/{rule}" for rule in rules}


def test_nodes_do_what_the_policy_allows_and_nothing_else(domain: int, peer: Peer) -> None:
    node = peer.node
    asks: tuple[tuple[Callable[..., Any], Callable[[str], list[str]]], ...] = (
        (node.get_publisher_names_and_types_by_node, published),
        (node.get_subscriber_names_and_types_by_node, heard),
        (node.get_service_names_and_types_by_node, answered),
    )
    # The viewer listens while somebody looks.
    peer.listen("view/markers", MarkerArray)
    with running(",".join(NODES), domain, "five_bar"):
        for name in NODES:
            peer.until(lambda name=name: name in peer.node.get_node_names(), f"the node {name}")
        for ask, rules in asks:
            for name in NODES:
                wanted = _patterns(rules(name))
                needed = {rule for rule in wanted if rule not in SOME and not rule.endswith("/*")}

                def lacking(ask=ask, name=name, wanted=wanted, needed=needed) -> list[str]:
                    there = _names(ask(name, "/"))
                    return [
                        rule
                        for rule in needed
                        if not any(fnmatchcase(one, wanted[rule]) for one in there)
                    ]

                with contextlib.suppress(TimeoutError):
                    peer.until(lambda lacking=lacking: not lacking(), "all that is named")
                assert not lacking(), (name, rules.__name__)
                there = _names(ask(name, "/"))
                wild = [
                    one
                    for one in there
                    if not any(fnmatchcase(one, pattern) for pattern in wanted.values())
                ]
                assert not wild, (name, rules.__name__, wild)
