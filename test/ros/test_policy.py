# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The policy for SROS2 against a running graph: what nodes do is allowed, and is all there is."""

from __future__ import annotations

import contextlib
from collections.abc import Callable
from fnmatch import fnmatchcase
from importlib.util import find_spec
from typing import Any

import pytest
from visualization_msgs.msg import MarkerArray

from hapticmech_ros.bag.check import OPTIONAL
from hapticmech_ros.wire.table import answered, published, requested, subscribed
from hapticmech_ros.wire.topics import DEVICE_BODY_FORCE, DIAGNOSTICS, TOPICS
from ros.harness import Peer, running

NODES = (
    *("haptic_device", "mechanism_simulator", "nullspace_analyser", "teleoperation_controller"),
    "scene_viewer",
)
# Of what is not in every graph: contacts, drivers with axes of their own, tf2's messages.
SOME = {t.name.replace("{point}", "*") for t in TOPICS if t.rate in OPTIONAL}
SOME |= {DEVICE_BODY_FORCE.name} | {"/tf", "/tf_static", "/clock", "/parameter_events"}
# Of other users, of whom this graph has none: a device hears their samples.
OF_OTHERS = {("haptic_device", "subscribed", "device/state")}


def _names(found: list[tuple[str, list[str]]]) -> set[str]:
    return {name for name, _ in found}


def _patterns(rules: list[str]) -> dict[str, str]:
    return {rule: rule if rule.startswith("/") else f"/{rule}" for rule in rules}


def _lacking(there: set[str], rules: list[str]) -> list[str]:
    """Return what is allowed and named, and not there."""
    needed = [(rule, name) for rule, name in _patterns(rules).items() if rule not in SOME]
    return [
        rule
        for rule, pattern in needed
        if not rule.endswith("/*") and not any(fnmatchcase(one, pattern) for one in there)
    ]


def _wild(there: set[str], rules: list[str]) -> list[str]:
    """Return what is there, and not allowed."""
    patterns = _patterns(rules).values()
    return [one for one in there if not any(fnmatchcase(one, pattern) for pattern in patterns)]


def test_nodes_do_what_the_policy_allows_and_nothing_else(domain: int, peer: Peer) -> None:
    node = peer.node
    asks: tuple[tuple[Callable[..., Any], Callable[[str], list[str]]], ...] = (
        (node.get_publisher_names_and_types_by_node, published),
        (node.get_subscriber_names_and_types_by_node, subscribed),
        (node.get_service_names_and_types_by_node, answered),
    )
    # The viewer listens while somebody looks.
    peer.listen("view/markers", MarkerArray)
    with running(",".join(NODES), domain, "five_bar"):
        for name in NODES:
            peer.until(lambda name=name: name in peer.node.get_node_names(), f"the node {name}")
        for ask, rules in asks:
            for name in NODES:
                allowed = rules(name)

                def lacking(ask=ask, name=name, allowed=allowed, rules=rules) -> list[str]:
                    needed = [
                        rule for rule in allowed if (name, rules.__name__, rule) not in OF_OTHERS
                    ]
                    return _lacking(_names(ask(name, "/")), needed)

                with contextlib.suppress(TimeoutError):
                    peer.until(lambda lacking=lacking: not lacking(), "all that is named")
                assert not lacking(), (name, rules.__name__)
                wild = _wild(_names(ask(name, "/")), allowed)
                assert not wild, (name, rules.__name__, wild)


@pytest.mark.skipif(find_spec("viser") is None, reason="viser, of the extra live, is not installed")
def test_the_live_page_does_what_the_policy_allows(domain: int, peer: Peer) -> None:
    """While nobody looks at it, it hears of diagnostics alone."""
    node, page = peer.node, "live_page"
    with running(page, domain, "five_bar", port=8790):
        peer.until(lambda: page in node.get_node_names(), "the page's node")
        asks = (
            (node.get_publisher_names_and_types_by_node, published(page)),
            (node.get_service_names_and_types_by_node, answered(page)),
            (node.get_client_names_and_types_by_node, requested(page)),
        )
        for ask, allowed in asks:
            peer.until(
                lambda ask=ask, allowed=allowed: not _lacking(_names(ask(page, "/")), allowed),
                "all that is named",
            )
            assert not _wild(_names(ask(page, "/")), allowed)

        def listening() -> set[str]:
            return _names(node.get_subscriber_names_and_types_by_node(page, "/"))

        peer.until(lambda: DIAGNOSTICS.name in listening(), "the page to hear of diagnostics")
        assert not _wild(listening(), subscribed(page))
