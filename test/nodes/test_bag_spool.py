# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The queue between those who hear messages and the disk."""

from __future__ import annotations

import threading
from contextlib import closing
from pathlib import Path

import pytest

from bag.record import times
from hapticmech_ros.bag import BagReader, BagWriter
from hapticmech_ros.bag.metadata import offered_qos
from hapticmech_ros.bag.storage import Messages
from hapticmech_ros.errors import BagError
from hapticmech_ros.nodes.bags import recorded_topic
from hapticmech_ros.nodes.bags.bag_player import AHEAD, read_ahead
from hapticmech_ros.nodes.bags.recorded_topic import BagSpool

UINT8 = "std_msgs/msg/UInt8"
DATA = b"\x00\x01\x00\x00\x07"


class StalledWriter(BagWriter):
    """A disk that does nothing until it is let go, and may then be full."""

    def __init__(self, path: Path, full: bool = False) -> None:
        super().__init__(path)
        self.go = threading.Event()
        self._full = full

    def write_many(self, name: str, messages: Messages) -> None:
        assert self.go.wait(30.0)
        if self._full:
            raise BagError("no space left")
        super().write_many(name, messages)


def spooled(path: Path, number: int, full: bool = False) -> BagSpool:
    """Return a spool with so many messages for a disk that stalls until all have been put."""
    writer = StalledWriter(path, full)
    spool = BagSpool(writer)
    spool.add_topic("/v", UINT8, [offered_qos("stream")])
    for i in range(number):
        spool.put("/v", [(i, DATA)])
    writer.go.set()
    return spool


def test_a_disk_that_stalls_delays_nobody(tmp_path: Path) -> None:
    spool = spooled(tmp_path / "bag", 20_000)
    spool.close()
    assert not spool.dropped
    assert times(tmp_path / "bag") == list(range(20_000))


def test_a_queue_that_is_full_drops_and_counts(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(recorded_topic, "LONGEST_QUEUE_BYTES", 100 * len(DATA))
    spool = spooled(tmp_path / "bag", 500)
    spool.close()
    assert spool.dropped == {"/v": 500 - 101}
    with BagReader(tmp_path / "bag") as bag:
        assert bag.topics["/v"].count == 101


def test_a_full_disk_is_told_and_the_bag_is_finished(tmp_path: Path) -> None:
    spool = spooled(tmp_path / "bag", 1, full=True)
    with pytest.raises(BagError, match="no space left"):
        spool.close()
    with BagReader(tmp_path / "bag") as bag:
        assert bag.topics["/v"].count == 0


def test_reading_ahead_hands_on_everything_and_the_end() -> None:
    messages = [("/v", i, DATA) for i in range(10_000)]
    assert list(read_ahead(iter(messages))) == messages
    # Left early: the thread ends all the same.
    left = iter(messages)
    with closing(read_ahead(left)) as ahead:
        assert next(ahead) == messages[0]
    assert next(left) == messages[2 * AHEAD]


def test_reading_ahead_hands_on_damage() -> None:
    def damaged():  # type: ignore[no-untyped-def]
        yield ("/v", 1, DATA)
        raise BagError("broken here")

    ahead = read_ahead(damaged())
    assert next(ahead) == ("/v", 1, DATA)
    with pytest.raises(BagError, match="broken here"):
        next(ahead)
