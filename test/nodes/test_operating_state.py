# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""CRTK's operating state of device and mechanism: told when it changes, and obeyed when it is."""

from __future__ import annotations

import sys
from types import ModuleType, SimpleNamespace

import numpy as np
import pytest
from rclpy.serialization import serialize_message
from std_msgs.msg import String
from std_srvs.srv import SetBool

from benchmarks.reliability.fake_graph import ACTORS, FakeGraph
from hapticmech_ros.nodes.operating_state import COMMANDS
from hapticmech_ros.wire.topics import (
    EMERGENCY_STOP,
    TEXT,
    crtk_type,
)
from nodes.stand_ins import applied
from sampling import sampled

DEVICE, MECHANISM = "haptic_device", "mechanism_simulator"
PLACES = {DEVICE: "/device", MECHANISM: "/mechanism/handle"}
EACH = pytest.mark.parametrize("node", PLACES)


@pytest.fixture
def graph():
    found = FakeGraph("five_bar", actors=ACTORS[:4])
    found.run(0.5)
    assert force_now(found) > 0.1
    return found


def force_now(graph):
    return float(np.linalg.norm(applied(graph)[:3]))


def state_of(graph, node):
    return graph.last[f"{PLACES[node]}/operating_state"].data


def command(graph, node, word):
    graph.put(f"{PLACES[node]}/state_command", serialize_message(String(data=word)))


def stop(graph, on):
    service = graph.hosts[DEVICE].services[EMERGENCY_STOP]
    assert service(SetBool.Request(data=on), SetBool.Response()).success


@EACH
def test_disable_deactivates_with_nobody_under_a_force_and_enable_activates(graph, node):
    command(graph, node, "disable")
    assert state_of(graph, node) == "DISABLED"
    assert not graph.hosts[node].active
    graph.run(0.03)
    assert force_now(graph) == 0.0
    command(graph, node, " Enable ")
    assert state_of(graph, node) == "ENABLED"
    graph.run(1.0)
    assert force_now(graph) > 0.1


@EACH
def test_a_pause_lasts_until_it_is_ended(graph, node):
    command(graph, node, "pause")
    assert state_of(graph, node) == "PAUSED"
    graph.run(0.03)
    assert force_now(graph) == 0.0
    mechanism = graph.actor(MECHANISM)
    held = mechanism.state.q.copy()
    # What begins anew, as after a step of the clock, is paused as before.
    graph.actor(node).deactivate()
    graph.actor(node).activate()
    graph.run(0.2)
    assert state_of(graph, node) == "PAUSED"
    assert force_now(graph) == 0.0
    if node == MECHANISM:
        assert (mechanism.state.q == held).all()
    assert not graph.actor(node).status()[0]
    assert "paused" in graph.actor(node).status()[1]
    command(graph, node, "resume")
    assert state_of(graph, node) == "ENABLED"
    graph.run(1.0)
    assert force_now(graph) > 0.1
    assert graph.seen.beyond == 0


def test_a_paused_device_puts_its_actuators_at_zero_at_once(graph):
    command(graph, DEVICE, "pause")
    assert force_now(graph) == 0.0


@EACH
def test_what_is_not_homed_is_not_moved(graph, node):
    command(graph, node, "unhome")
    graph.run(0.1)
    assert force_now(graph) == 0.0
    assert "not homed" in graph.actor(node).status()[1]
    command(graph, node, "home")
    graph.run(1.0)
    assert force_now(graph) > 0.1


@pytest.mark.parametrize("word", sampled(COMMANDS, every=2))
def test_no_command_releases_an_emergency_stop(graph, word):
    stop(graph, on=True)
    assert state_of(graph, DEVICE) == "FAULT"
    command(graph, DEVICE, word)
    graph.run(0.1)
    assert force_now(graph) == 0.0
    command(graph, DEVICE, "enable")
    command(graph, DEVICE, "home")
    graph.run(0.5)
    assert state_of(graph, DEVICE) == "FAULT"
    assert force_now(graph) == 0.0
    stop(graph, on=False)
    assert state_of(graph, DEVICE) == "ENABLED"
    graph.run(1.0)
    assert force_now(graph) > 0.1


@EACH
@pytest.mark.parametrize("message", [serialize_message(String(data="go")), b"", b"\x00" * 7])
def test_other_words_are_refused_and_counted(graph, node, message):
    host = graph.hosts[node]
    graph.put(f"{PLACES[node]}/state_command", message)
    assert host.refused == 1
    assert "state_command" in host.last_refusal
    assert state_of(graph, node) == "ENABLED"
    assert host.actor.failures.count == 0


@EACH
def test_a_state_is_published_when_it_is_another_or_answers_a_command(graph, node):
    sent = []
    graph.sent = lambda topic, kind, message: sent.append(topic)
    graph.run(0.2)
    assert not any(topic.endswith("operating_state") for topic in sent)
    # Who came late waits for the state that was there before.
    command(graph, node, "enable")
    assert sent.count(f"{PLACES[node]}/operating_state") == 1


def test_with_crtks_messages_installed_the_topics_have_their_types(monkeypatch):
    assert crtk_type("OperatingState") == TEXT
    found = ModuleType("crtk_msgs")
    found.__spec__ = SimpleNamespace()
    monkeypatch.setitem(sys.modules, "crtk_msgs", found)
    assert crtk_type("OperatingState") == "crtk_msgs/msg/OperatingState"
