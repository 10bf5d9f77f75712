# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Waiting for messages: for as long as was said, until a future is done, and leaving nothing."""

from __future__ import annotations

import gc
import sys
import time

import pytest
import rclpy
from rclpy.task import Future
from std_msgs.msg import UInt8

from hapticmech_ros.nodes.entry import NODES
from hapticmech_ros.nodes.exchange import Exchange
from hapticmech_ros.nodes.loop import wait_for_messages
from hapticmech_ros.nodes.managed import ManagedNode
from hapticmech_ros.nodes.runtime import actor_type
from ros.harness import RELIABLE, Peer


def test_waiting_leaves_nothing_behind(peer: Peer) -> None:
    """A thousand waits in a second, for an hour and for good."""
    waits = 2000
    for _ in range(200):
        wait_for_messages(peer.executor, 20e-6)
    gc.collect()
    before = sys.getallocatedblocks()
    for _ in range(waits):
        wait_for_messages(peer.executor, 20e-6)
    gc.collect()
    assert sys.getallocatedblocks() - before < 0.1 * waits


def test_it_waits_as_long_as_it_was_told_and_hears_all(peer: Peer) -> None:
    received = peer.listen("number", UInt8)
    publisher = peer.publisher("number", UInt8, RELIABLE)
    for number in range(20):
        publisher.publish(UInt8(data=number))
    begun = time.monotonic()
    while len(received) < 20 and time.monotonic() - begun < 10.0:
        wait_begun = time.monotonic()
        wait_for_messages(peer.executor, 0.2)
        assert time.monotonic() - wait_begun >= 0.2
    assert [message.data for message in received] == list(range(20))


def test_a_future_ends_it(peer: Peer) -> None:
    done: Future = Future()
    peer.node.create_subscription(UInt8, "number", lambda message: done.set_result(True), RELIABLE)
    publisher = peer.publisher("number", UInt8, RELIABLE)
    publisher.publish(UInt8(data=1))
    begun = time.monotonic()
    wait_for_messages(peer.executor, 30.0, until=done)
    assert time.monotonic() - begun < 20.0
    wait_for_messages(peer.executor, 30.0, until=done)
    assert time.monotonic() - begun < 20.0


@pytest.mark.parametrize("name", NODES)
def test_every_callback_waits_for_its_actor_to_know_what_its_kernel_did(
    name: str, in_domain: int
) -> None:
    rclpy.init(args=["--ros-args", "-p", "scene:=five_bar"])
    node = ManagedNode(actor_type(name), Exchange())
    try:
        node.start()
        # Some take their turn for a part of what they do.
        apart = f"{ManagedNode.every.__qualname__}.<locals>.when_active"
        timers = [one for one in node.timers if one is not node._timer]
        timers = [one for one in timers if one.callback.__qualname__ != apart]
        entities = [*node.subscriptions, *node.services, *timers]
        settled = node._settled(print).__code__
        assert [one for one in entities if one.callback.__code__ is not settled] == []
        # The executor runs nothing else of it.
        assert not [*node.clients, *node.guards]
        assert len(entities) > 12
    finally:
        node.destroy_node()
        rclpy.shutdown()
