# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""``hapticmech bag record`` in a graph: what it finds, how it subscribes, how it ends."""

from __future__ import annotations

import signal
import subprocess
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest
from geometry_msgs.msg import WrenchStamped
from rclpy.executors import SingleThreadedExecutor
from rclpy.experimental import EventsExecutor
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.serialization import deserialize_message
from rosbags.interfaces import QosDurability
from rosgraph_msgs.msg import Clock
from std_msgs.msg import UInt8

from hapticmech_ros.bag import BagReader
from hapticmech_ros.nodes.bags.recorded_topic import adapted_offer, adapted_request, as_recorded
from hapticmech_ros.nodes.messages import LATCHED
from hapticmech_ros.nodes.sources import WithInfo
from ros.bag_processes import bag_command, ended
from ros.harness import Peer

RELIABLE = QoSProfile(depth=100)
BEST_EFFORT = QoSProfile(depth=100, reliability=ReliabilityPolicy.BEST_EFFORT)


def end(recorder: subprocess.Popen[str]) -> str:
    """Interrupt a recorder twice, as a terminal with a launcher does; return what it printed."""
    return ended(recorder, signal.SIGINT, signal.SIGINT)


def publish(peer: Peer, publisher: Any, values: range) -> None:
    for value in values:
        publisher.publish(UInt8(data=value))
        peer.run(0.002)


def values(bag: Path, topic: str) -> list[int]:
    with BagReader(bag) as reader:
        return [item.message.data for item in reader.messages(topic)]


@pytest.mark.parametrize("storage", ["mcap", "sqlite3"])
def test_records_every_topic_as_it_is_offered(
    storage: str, peer: Peer, domain: int, tmp_path: Path
) -> None:
    latched = peer.node.create_publisher(UInt8, "/latched", LATCHED)
    latched.publish(UInt8(data=42))
    bag = tmp_path / "bag"
    with bag_command(domain, "record", "--all", "-o", bag, "-s", storage) as recorder:
        stamped = peer.publisher("/stamped", WrenchStamped)
        sent = []
        for i in range(50):
            message = peer.wrench(float(i), 0.0, 0.0, 0.0, 0.0, 0.0)
            sent.append(message)
            stamped.publish(message)
            peer.run(0.002)
        reliable = peer.publisher("/mixed", UInt8, RELIABLE)
        publish(peer, reliable, range(10))
        # The subscription that heard the first does not hear this one: another replaces it.
        mixed = peer.publisher("/mixed", UInt8, BEST_EFFORT)
        publish(peer, mixed, range(10, 20))
        publish(peer, reliable, range(20, 30))
        late = peer.publisher("/late", UInt8)
        publish(peer, late, range(30))
        peer.run(0.5)
        text = end(recorder)
    with BagReader(bag) as reader:
        _, times, written = zip(*reader.serialized("/stamped"), strict=True)
        # Not byte by byte: rclpy leaves whatever it finds between the fields of a message.
        assert [deserialize_message(data, WrenchStamped) for data in written] == sent
        first = sent[0].header.stamp
        assert 0 < times[0] - (first.sec * 10**9 + first.nanosec) < 10**10
        (offer,) = reader.topics["/latched"].offered
        assert offer.durability is QosDurability.TRANSIENT_LOCAL
        assert reader.topics["/stamped"].type_hash.startswith("RIHS01_")
        offered = [offer.reliability for offer in reader.topics["/mixed"].offered]
    assert len(offered) == len(set(offered)) == 2
    assert values(bag, "/latched") == [42]
    assert values(bag, "/late") == list(range(30))
    assert values(bag, "/mixed") == list(range(30))
    assert "/stamped: 50 messages, 0 lost" in text
    assert "/mixed: 30 messages, losses unknown: several publishers" in text


def test_a_topic_that_never_pauses_and_brings_nothing_is_named(
    peer: Peer, domain: int, tmp_path: Path
) -> None:
    with bag_command(domain, "record", "--all", "-o", tmp_path / "bag") as recorder:
        for name in ("/one/device/measured_cf", "/one/joint_states", "/one/of_a_stranger"):
            peer.publisher(name, UInt8)
        publish(peer, peer.publisher("/one/mechanism/measured_js", UInt8), range(10))
        text = end(recorder)
    assert "no messages from /one/device/measured_cf, /one/joint_states: not sent" in text
    assert "/one/of_a_stranger: 0 messages, losses unknown" in text


def test_times_of_the_graph_and_chosen_topics(peer: Peer, domain: int, tmp_path: Path) -> None:
    clock = peer.node.create_publisher(Clock, "/clock", RELIABLE)
    wanted = peer.node.create_publisher(UInt8, "/left/arm/value", RELIABLE)
    peer.node.create_publisher(UInt8, "/right/arm/value", RELIABLE)
    options = ("--namespace", "left", "--regex", "/(left|right)/arm", "--use-sim-time")
    with bag_command(domain, "record", *options, "-o", tmp_path / "bag") as recorder:
        peer.until(lambda: wanted.get_subscription_count() > 0, "the recorder")
        peer.until(lambda: clock.get_subscription_count() > 0, "its clock")
        times = []
        for second in range(100, 140):
            message = Clock()
            message.clock.sec = second
            clock.publish(message)
            peer.run(0.03)
            wanted.publish(UInt8(data=second))
            peer.run(0.03)
        assert end(recorder)
    with BagReader(tmp_path / "bag") as reader:
        assert list(reader.topics) == ["/left/arm/value", "/right/arm/value"]
        times = [(t, reader.decode(n, d).data) for n, t, d in reader.serialized("/left/arm/value")]
    assert len(times) == 40
    # The clock may have been heard a little before or after the message.
    assert all(abs(time // 10**9 - value) <= 1 for time, value in times)
    assert all(time % 10**9 == 0 for time, _ in times)


def test_splits_while_recording(peer: Peer, domain: int, tmp_path: Path) -> None:
    bag, split = tmp_path / "bag", ("--split-duration", "0.5")
    with bag_command(domain, "record", "/value", "/nobody", *split, "-o", bag) as recorder:
        publisher = peer.publisher("/value", UInt8)
        sent = 0

        def has_split_twice() -> bool:
            nonlocal sent
            publisher.publish(UInt8(data=sent % 256))
            sent += 1
            return (bag / "bag_2.mcap").exists()

        peer.until(has_split_twice, "a third file")
        text = end(recorder)
    got = values(bag, "/value")
    # None is lost or doubled where a file ends, and none is out of order.
    assert [(after - before) % 256 for before, after in pairwise(got)] == [1] * (len(got) - 1)
    assert len(got) > sent / 2
    assert f"/value: {len(got)} messages, 0 lost" in text
    assert "/nobody: not published" in text


def test_ends_by_itself(domain: int, tmp_path: Path) -> None:
    bag = tmp_path / "bag"
    with bag_command(domain, "record", "--all", "--duration", "0.3", "-o", bag) as recorder:
        assert recorder.wait(30.0) == 0
    with BagReader(bag) as reader:
        assert reader.span_ns == (0, 0)


def test_refuses_to_overwrite(domain: int, tmp_path: Path) -> None:
    with bag_command(domain, "record", "-o", tmp_path) as recorder:
        assert recorder.wait(30.0) == 1
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("kind", [EventsExecutor, SingleThreadedExecutor])
@pytest.mark.parametrize("raw", [True, False])
def test_callbacks_get_the_number_of_a_message(kind: Any, raw: bool, peer: Peer) -> None:
    received: list[int] = []

    def note(message: Any, info: Any) -> None:
        assert isinstance(message, bytes if raw else UInt8)
        received.append(info["publication_sequence_number"])

    peer.executor.remove_node(peer.node)
    peer.executor = kind(context=peer.context)
    peer.executor.add_node(peer.node)
    peer.node.create_subscription(UInt8, "/value", WithInfo(note), RELIABLE, raw=raw)
    publisher = peer.publisher("/value", UInt8)
    for value in range(5):
        publisher.publish(UInt8(data=value))
    peer.until(lambda: len(received) == 5, "five messages")
    assert received == list(range(received[0], received[0] + 5))


def test_requests_suit_every_publisher_and_offers_every_reader() -> None:
    strict = adapted_request([LATCHED, LATCHED])
    assert strict.durability == DurabilityPolicy.TRANSIENT_LOCAL
    assert strict.reliability == ReliabilityPolicy.RELIABLE
    loose = adapted_request([LATCHED, BEST_EFFORT])
    assert loose.durability == DurabilityPolicy.VOLATILE
    assert loose.reliability == ReliabilityPolicy.BEST_EFFORT
    offer = adapted_offer([as_recorded(LATCHED), as_recorded(BEST_EFFORT)])
    assert offer.durability == DurabilityPolicy.TRANSIENT_LOCAL
    assert offer.reliability == ReliabilityPolicy.RELIABLE
    assert adapted_offer([as_recorded(BEST_EFFORT)]).reliability == ReliabilityPolicy.BEST_EFFORT
    assert adapted_offer([]).reliability == ReliabilityPolicy.RELIABLE
    assert adapted_offer([as_recorded(LATCHED)]).depth == 1
