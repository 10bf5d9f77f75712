# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Gains that the device is told, by the controller and by others: one thread, made-up time."""

from __future__ import annotations

from collections import Counter
from types import SimpleNamespace

import numpy as np
import pytest

from benchmarks.reliability.fake_graph import ACTORS, FakeGraph
from hapticmech_ros.wire.cdr import FlatArray
from hapticmech_ros.wire.messages import LocalFeedbackGain
from nodes.stand_ins import applied

TOPIC = "/device/local_feedback_gain"
DEVICE = "haptic_device"
SECOND_NS = 1_000_000_000


@pytest.fixture
def graph():
    # Without the viewer, which costs most.
    found = FakeGraph("five_bar", [], ACTORS[:4])
    found.run(0.3)
    assert found.hosts[DEVICE].actor.status()[0]
    assert applied(found).any()
    return found


def gain_at(stamp_ns):
    """Return the bytes of gains that turn micrometres into newtons, and give energy away."""
    stiff = np.concatenate((np.zeros(36), np.diag([1e6] * 3 + [1e3] * 3).ravel(), np.zeros(36)))
    told = LocalFeedbackGain.answering(stamp_ns, stamp_ns, 1e3, stiff)
    return bytes(FlatArray(LocalFeedbackGain.layout).encode(told.values))


def say(graph, message):
    """Bring a message of somebody who is in none of the graph's processes."""
    graph.put(TOPIC, message, 7)


def test_with_the_first_gain_of_a_second_publisher_force_is_zero(graph):
    say(graph, gain_at(graph.now_ns))
    assert not applied(graph).any()
    well, sentence, figures = graph.hosts[DEVICE].actor.status()
    assert not well
    assert f"more than one publisher of {TOPIC}: " in sentence
    assert figures["fault"] in sentence
    for _ in range(100):
        graph.run(0.005)
        say(graph, gain_at(graph.now_ns))
        assert not applied(graph).any()
    # Once it has been silent for a second.
    graph.run(1.5)
    assert graph.hosts[DEVICE].actor.status()[0]
    assert applied(graph).any()


@pytest.mark.parametrize("apart_s", [-10, 10])
def test_gains_of_another_time_are_refused_and_hold_up_no_others(graph, apart_s):
    host = graph.hosts[DEVICE]
    before = host.refused
    graph.put(TOPIC, gain_at(graph.now_ns + apart_s * SECOND_NS))
    assert host.refused == before + 1
    assert "age of stamp, s: must be within 0.25 s" in host.last_refusal
    graph.run(0.1)
    assert host.actor.status()[2]["overtaken_gains"] == "0"
    assert host.actor.status()[0]


@pytest.fixture
def sent(graph):
    """How many messages the graph's nodes have sent, by topic."""
    found, send = Counter(), graph.sent

    def count(topic, kind, message):
        found[topic] += 1
        send(topic, kind, message)

    graph.sent = count
    return found


def test_until_the_device_obeys_every_command_comes_with_its_gain(graph, sent):
    stop = graph.hosts[DEVICE].services["device/emergency_stop"]
    stop(SimpleNamespace(data=True), SimpleNamespace())
    # The controller knows of it by the next sample.
    graph.run(0.002)
    sent.clear()
    graph.run(0.1)
    assert not applied(graph).any()
    assert sent["/device/servo_cf"] >= 99
    assert sent[TOPIC] == sent["/device/servo_cf"]
    # So that two who tell gains are noticed with the first command that could be obeyed.
    stop(SimpleNamespace(data=False), SimpleNamespace())
    graph.run(0.1)
    assert applied(graph).any()
    sent.clear()
    graph.run(0.1)
    assert 9 <= sent[TOPIC] <= 11


@pytest.mark.parametrize(("view_rate", "most"), [(1.0, 52), (20.0, 52), (100.0, 101)])
def test_gains_come_often_enough_however_rarely_people_look(graph, sent, view_rate, most):
    actor = graph.hosts["teleoperation_controller"].actor
    actor.apply_parameters(actor.parameters.model_copy(update={"view_rate": view_rate}))
    sent.clear()
    graph.run(1.0)
    assert most - 3 <= sent[TOPIC] <= most
