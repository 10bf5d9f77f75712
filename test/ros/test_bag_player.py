# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""``hapticmech bag play`` in a graph: what it publishes, when, and how it is steered."""

from __future__ import annotations

import os
import pty
import signal
import subprocess
import sys
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rclpy.qos import QoSProfile
from rosgraph_msgs.msg import Clock
from std_msgs.msg import Float64MultiArray, UInt8
from std_srvs.srv import Trigger

from hapticmech_ros.bag import BagReader, BagWriter
from hapticmech_ros.bag.compare import compare
from hapticmech_ros.nodes.messages import LATCHED
from hapticmech_ros.wire.cdr import FlatArray
from ros.bag_processes import bag_command, ended
from ros.harness import Peer, program

SECOND = 1_000_000_000
START = 1_700_000_000 * SECOND
FIELDS = {"stamp": 2, "value": 1}
WAIT = ("--wait-for-subscribers", "20")


@pytest.fixture
def bag(tmp_path: Path) -> Path:
    return write(tmp_path / "bag")


def write(path: Path, storage: str = "mcap") -> Path:
    """Write a second of 500 Hz, and a status that changes once; return where."""
    flat = FlatArray(FIELDS)
    with BagWriter(path, storage, split_ns=SECOND // 2) as writer:
        writer.add_topic("/arm/state", "std_msgs/msg/Float64MultiArray")
        writer.add_topic("/status", "std_msgs/msg/UInt8", "latched")
        for i in range(500):
            time_ns = START + i * SECOND // 500
            data = flat.encode(np.array([*divmod(time_ns, SECOND), i / 7]))
            writer.write("/arm/state", time_ns, data)
            if i in (40, 300):
                # On the wire a message is filled up to a multiple of four bytes.
                writer.write("/status", time_ns + 1, bytes((0, 1, 0, 0, i // 40, 0, 0, 0)))
    return path


end = partial(ended, within_s=60.0)


def numbers(messages: list[Any]) -> list[float]:
    return [message.data[2] for message in messages]


def call(peer: Peer, verb: str) -> str:
    answer = peer.call(Trigger, f"/bag_player/{verb}", Trigger.Request())
    assert answer.success
    return str(answer.message)


@pytest.mark.parametrize("storage", ["mcap", "sqlite3"])
def test_what_is_played_and_recorded_again_is_the_same(
    storage: str, domain: int, tmp_path: Path
) -> None:
    bag, again = write(tmp_path / "bag", storage), tmp_path / "again"
    with bag_command(domain, "record", "/arm/state", "/status", "-o", again) as recorder:
        assert "recording into" in recorder.stdout.readline()
        with bag_command(domain, "play", bag, *WAIT) as player:
            assert "502 messages played" in end(player)
        assert "0 lost" in end(recorder, signal.SIGTERM)
    report = compare(bag, again)
    assert report.is_exact
    assert {topic.name: topic.matched for topic in report.topics} == {
        "/arm/state": 500,
        "/status": 2,
    }
    # Played with the recorded QoS, so that a player of the copy does the same again.
    with BagReader(again) as reader:
        assert {o.durability.name for o in reader.topics["/status"].offered} == {"TRANSIENT_LOCAL"}


def test_plays_at_a_rate_with_the_bags_clock(bag: Path, peer: Peer, domain: int) -> None:
    received = peer.listen("/arm/state", Float64MultiArray)
    clock = peer.listen("/clock", Clock)
    options = ("--rate", "0.5", "--clock", "200", "--start-offset", "0.2", "--duration", "0.6")
    with bag_command(domain, "play", bag, "/arm/state", *options, *WAIT) as player:
        assert "300 messages played" in end(player)
        peer.until(lambda: len(received) == 300 and len(clock) > 10, "all messages")
        peer.run(0.1)
    assert numbers(received) == [i / 7 for i in range(100, 400)]
    times = [message.clock.sec * SECOND + message.clock.nanosec for message in clock]
    assert times == sorted(times)
    assert START + SECOND // 5 <= times[0] < times[-1]
    # On a grid of 1/200 s at half speed, however many a stall has swallowed.
    assert 10 < len(times) <= 241 + 2


def test_pauses_and_resumes(bag: Path, peer: Peer, domain: int) -> None:
    received = peer.listen("/arm/state", Float64MultiArray)
    # Half a second of messages, in 2.5 s: a starved peer asks to pause before the end.
    slowly = ("--rate", "0.2", "--paused")
    with bag_command(domain, "play", bag, "/arm/state", *slowly, *WAIT) as player:
        peer.client(Trigger, "/bag_player/toggle_paused")
        assert call(peer, "pause") == "paused"
        peer.run(0.3)
        assert received == []
        assert call(peer, "resume") == "playing"
        peer.until(lambda: len(received) > 10, "messages after resuming")
        assert call(peer, "toggle_paused") == "paused"
        peer.run(0.2)
        count = len(received)
        peer.run(0.3)
        assert count == len(received) < 500
        assert call(peer, "toggle_paused") == "playing"
        assert "500 messages played" in end(player)
        peer.until(lambda: len(received) == 500, "all messages")
    assert numbers(received) == [i / 7 for i in range(500)]


def test_remaps_loops_and_ends_on_a_signal(bag: Path, peer: Peer, domain: int) -> None:
    received = peer.listen("/there", Float64MultiArray)
    status = peer.listen("/left/status", UInt8)
    options = ("--remap", "/arm/state:=/there", "--namespace", "left", "--loop", "--rate", "2")
    with bag_command(domain, "play", bag, *options, *WAIT) as player:
        peer.until(lambda: len(received) > 1200, "the third round")
        end(player, signal.SIGINT, signal.SIGINT)
    assert numbers(received)[:1000] == [i / 7 for i in range(500)] * 2
    assert [message.data for message in status][:4] == [1, 7, 1, 7]


def test_latched_messages_come_first_and_to_those_who_are_late(
    bag: Path, peer: Peer, domain: int
) -> None:
    order: list[str] = []
    peer.node.create_subscription(UInt8, "/status", lambda _: order.append("status"), LATCHED)
    peer.node.create_subscription(
        Float64MultiArray, "/arm/state", lambda _: order.append("state"), QoSProfile(depth=1000)
    )
    with bag_command(domain, "play", bag, "--start-offset", "0.5", "--paused", *WAIT) as player:
        peer.until(lambda: order == ["status"], "the latched message")
        late: list[Any] = []
        peer.node.create_subscription(UInt8, "/status", late.append, LATCHED)
        peer.until(lambda: len(late) == 1, "the latched message once more")
        assert late[0].data == 1
        call(peer, "resume")
        end(player)
        peer.until(lambda: order.count("state") == 250, "all messages")
    assert order.count("status") == 2


@pytest.fixture
def terminal() -> Iterator[tuple[int, int]]:
    """Return both ends of a terminal."""
    outer, inner = pty.openpty()
    yield outer, inner
    os.close(outer)
    os.close(inner)


def test_space_pauses(terminal: tuple[int, int], peer: Peer, domain: int, bag: Path) -> None:
    received = peer.listen("/arm/state", Float64MultiArray)
    # In a session whose controlling terminal is ours, as a shell would start it.
    main = (
        "import fcntl, os, termios; os.setsid(); fcntl.ioctl(0, termios.TIOCSCTTY, 0); "
        "from hapticmech_ros.cli import main; main()"
    )
    command = sys.executable, "-c", main, "bag", "play", bag, "--paused"
    with program(domain, *command, stdin=terminal[1], stdout=subprocess.PIPE) as player:
        peer.client(Trigger, "/bag_player/pause")
        peer.until(lambda: peer.node.count_publishers("/arm/state") > 0, "its publisher")
        peer.run(0.5)
        assert received == []
        os.write(terminal[0], b"x ")
        peer.until(lambda: len(received) > 0, "messages after the space key")
        assert "space pauses" in end(player)


def test_says_what_cannot_be_played(domain: int, tmp_path: Path) -> None:
    for arguments in (
        (tmp_path / "nowhere",),
        (write(tmp_path / "bag"), "/nothing"),
        (tmp_path / "bag", "--remap", "/nothing:=/x"),
        (tmp_path / "bag", "--remap", "x"),
        (tmp_path / "bag", "--start-offset", "5"),
    ):
        with bag_command(domain, "play", *arguments) as player:
            assert player.wait(30.0) == 1
