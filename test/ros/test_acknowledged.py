# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The last messages of a publisher: others have them before it is destroyed."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import closing, contextmanager
from functools import partial
from typing import Any

import pytest
import rclpy
from std_msgs.msg import Float64MultiArray, String

from benchmarks.children import wait_until
from hapticmech_ros.nodes import managed
from hapticmech_ros.nodes.exchange import Exchange
from hapticmech_ros.nodes.messages import wait_until_acknowledged
from hapticmech_ros.nodes.runtime import actor_type
from ros.harness import RELIABLE, Peer, program

TOPIC = "last_words"
# A subscriber in a process of its own, which can be stopped.
SUBSCRIBER = """
import sys
import rclpy
from std_msgs import msg
rclpy.init()
node = rclpy.create_node("subscriber")
node.create_subscription(getattr(msg, sys.argv[2]), sys.argv[1], lambda message: None, 10)
while rclpy.ok():
    rclpy.spin_once(node, timeout_sec=0.5)
"""


def test_what_was_acknowledged_arrives_though_its_publisher_is_gone(
    domain: int, peer: Peer
) -> None:
    received = peer.listen(TOPIC, String)
    with closing(Peer(domain)) as speaks:
        publisher = speaks.publisher(TOPIC, String, RELIABLE)
        for number in range(100):
            publisher.publish(String(data=str(number)))
        # Others of a node's entities have nothing to say.
        assert wait_until_acknowledged([object(), publisher], within_s=5.0)
        speaks.node.destroy_publisher(publisher)
        peer.until(lambda: len(received) == 100, "all messages of a publisher that is gone")
        assert [message.data for message in received] == [str(number) for number in range(100)]


@contextmanager
def standing_still(domain: int, publisher: Any, *messages: Any) -> Iterator[subprocess.Popen[str]]:
    """Let a subscriber hear the first of two messages, and stand still before the second comes."""
    topic, kind = publisher.topic_name, type(messages[0]).__name__
    with program(domain, sys.executable, "-c", SUBSCRIBER, topic, kind) as process:
        wait_until(publisher.get_subscription_count, 20.0, f"a subscriber of {topic}")
        publisher.publish(messages[0])
        assert wait_until_acknowledged([publisher], within_s=5.0)
        os.kill(process.pid, signal.SIGSTOP)
        try:
            publisher.publish(messages[1])
            yield process
        finally:
            os.kill(process.pid, signal.SIGCONT)


def test_a_subscriber_that_stands_still_is_not_waited_for_long(domain: int, peer: Peer) -> None:
    publisher = peer.node.create_publisher(String, TOPIC, RELIABLE)
    messages = String(data="heard"), String(data="not heard")
    with standing_still(domain, publisher, *messages) as process:
        assert not wait_until_acknowledged([publisher])
        os.kill(process.pid, signal.SIGCONT)
        assert wait_until_acknowledged([publisher], within_s=5.0)


@pytest.mark.parametrize("step", ["end", "trigger_cleanup"])
def test_a_node_that_waits_holds_up_no_other_of_its_process(
    in_domain: int, monkeypatch: pytest.MonkeyPatch, step: str
) -> None:
    """A device would take longer than its command_timeout for the end of commands."""
    within_s = 2.0
    wait = partial(wait_until_acknowledged, within_s=within_s)
    monkeypatch.setattr(managed, "wait_until_acknowledged", wait)
    given = ["scene:=five_bar", "transport:=middleware"]
    rclpy.init(args=["--ros-args", *(word for one in given for word in ("-p", one))])
    node = managed.ManagedNode(actor_type("nullspace_analyser"), Exchange())
    rounds, ended = list[float](), threading.Event()

    def act() -> None:
        while not ended.wait(0.001):
            rounds.append(time.monotonic())

    other = threading.Thread(target=act)
    try:
        node.start()
        model = node.resolve_topic_name("analysis/handle/operational_model")
        publisher = next(one for one in node.publishers if one.topic_name == model)
        with standing_still(in_domain, publisher, Float64MultiArray(), Float64MultiArray()):
            node.trigger_deactivate()
            other.start()
            begun = time.monotonic()
            # When the process ends, or before what it has is destroyed.
            (node.acknowledged if step == "end" else node.trigger_cleanup)()
            assert time.monotonic() - begun >= within_s
        assert len([one for one in rounds if one - begun < within_s]) > 100
    finally:
        ended.set()
        other.join()
        node.destroy_node()
        rclpy.shutdown()
