# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""When a device must not obey: an emergency stop, and two that command."""

from types import SimpleNamespace

import pytest

from hapticmech_ros.nodes.sources import MIDDLEWARE, STOPPED, CommandGuard, Origin, Sources

MS = 1_000_000


class Middleware:
    """Knows two publishers of every topic."""

    def get_publishers_info_by_topic(self, topic):
        del topic
        return [
            SimpleNamespace(node_namespace="/", node_name=name, endpoint_gid=bytes(16))
            for name in ("one", "other")
        ]


def test_an_emergency_stop_lasts_and_comes_first():
    sources = Sources(Middleware(), "/device/servo_cf")
    guard = CommandGuard(sources)
    assert guard.fault(0) == ""
    guard.stopped = True
    sources.received(Origin(MIDDLEWARE, 100), 0)
    sources.received(Origin(MIDDLEWARE, 7), 0)
    assert guard.fault(1000 * MS) == STOPPED
    assert guard.fault(0) == STOPPED
    guard.stopped = False
    assert "/one and /other" in guard.fault(0)
    assert guard.fault(2000 * MS) == ""


@pytest.mark.parametrize("watched", [0, 1])
def test_two_on_either_topic_are_a_fault_that_names_both(watched):
    topics = "/device/servo_cf", "/device/local_feedback_gain"
    sources = [Sources(Middleware(), topic) for topic in topics]
    guard = CommandGuard(*sources)
    for one in sources:
        one.received(Origin(MIDDLEWARE, 100), 0)
    assert guard.fault(0) == ""
    sources[watched].received(Origin(MIDDLEWARE, 7), 0)
    assert guard.fault(0) == f"more than one publisher of {topics[watched]}: /one and /other"
    guard.forget()
    assert guard.fault(0) == ""


def test_an_input_that_nobody_uses_is_no_fault():
    commands, gains = (Sources(Middleware(), name) for name in ("/servo_cf", "/gain"))
    guard = CommandGuard(commands, gains)
    commands.received(Origin(MIDDLEWARE, 100), 0)
    assert guard.fault(0) == ""
