# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What a player plays, and when."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from hapticmech_ros.bag import BagReader, BagWriter
from hapticmech_ros.errors import BagError, InvalidInputError
from hapticmech_ros.nodes.bags.bag_player import Timeline, cut_of, latched_first, stream

UINT8 = "std_msgs/msg/UInt8"
SECOND = 1_000_000_000
START = 5 * SECOND


def uint8(value: int) -> bytes:
    return bytes((0, 1, 0, 0, value))


@pytest.fixture
def path(tmp_path: Path) -> Path:
    with BagWriter(tmp_path / "bag") as bag:
        bag.add_topic("/stream", UINT8)
        bag.add_topic("/status", UINT8, "latched")
        bag.add_topic("/late", UINT8, "latched")
        for i in range(100):
            bag.write("/stream", START + i * SECOND // 10, uint8(i))
            if i in (2, 40, 60):
                bag.write("/status", START + i * SECOND // 10 + 1, uint8(i))
        bag.write("/late", START + 8 * SECOND, uint8(200))
    return tmp_path / "bag"


def test_latched_messages_of_the_beginning_come_first(path: Path) -> None:
    with BagReader(path) as bag:
        cut = cut_of(bag)
        first = latched_first(bag, cut)
        rest = list(stream(bag, cut, first))
    assert first == [("/status", START + SECOND // 5 + 1, uint8(2))]
    assert len(rest) == 103
    assert not set(first) & set(rest)
    assert [t for _, t, _ in rest] == sorted(t for _, t, _ in rest)


def test_an_offset_brings_the_latched_message_that_stands_there(path: Path) -> None:
    with BagReader(path) as bag:
        cut = cut_of(bag, start_offset_s=5.0, duration_s=2.0)
        first = latched_first(bag, cut)
        rest = list(stream(bag, cut, first))
    assert [(name, data) for name, _, data in first] == [("/status", uint8(40))]
    assert [d[4] for name, _, d in rest if name == "/stream"] == list(range(50, 70))
    assert [d[4] for name, _, d in rest if name == "/status"] == [60]


def test_some_topics_only(path: Path) -> None:
    with BagReader(path) as bag:
        cut = cut_of(bag, ["/stream"])
        assert latched_first(bag, cut) == []
        assert {name for name, _, _ in stream(bag, cut, [])} == {"/stream"}


@pytest.mark.parametrize(
    ("given", "rule"),
    [
        ({"topics": ["/x"]}, "no topic /x"),
        ({"start_offset_s": 10.0}, "nothing to play after 10 s"),
        ({"start_offset_s": -1.0}, "must be positive"),
        ({"duration_s": 0.0}, "must be positive"),
    ],
)
def test_refuses_what_cannot_be_played(path: Path, given: dict[str, Any], rule: str) -> None:
    with BagReader(path) as bag, pytest.raises(BagError, match=rule):
        cut_of(bag, **given)


def test_of_an_empty_bag_nothing_can_be_played(tmp_path: Path) -> None:
    BagWriter(tmp_path / "empty").close()
    with BagReader(tmp_path / "empty") as bag, pytest.raises(BagError, match="nothing to play"):
        cut_of(bag)


@pytest.mark.parametrize("rate", [0.5, 1.0, 4.0])
def test_deadlines_and_times_are_inverse(rate: float) -> None:
    timeline = Timeline(START, 100, rate)
    for offset in (0, 8, 4000):
        assert timeline.bag_ns(timeline.deadline_ns(START + offset)) == START + offset
    assert timeline.deadline_ns(START + SECOND) == 100 + round(SECOND / rate)


def test_a_pause_shifts_what_comes_after_it_by_its_length() -> None:
    timeline = Timeline(START, 0, rate=2.0)
    before = timeline.deadline_ns(START + 10 * SECOND)
    timeline.pause(SECOND)
    assert timeline.bag_ns(SECOND) == timeline.bag_ns(9 * SECOND) == START + 2 * SECOND
    timeline.pause(3 * SECOND)
    timeline.resume(5 * SECOND)
    timeline.resume(6 * SECOND)
    assert timeline.deadline_ns(START + 10 * SECOND) == before + 4 * SECOND


def test_time_runs_forward() -> None:
    with pytest.raises(InvalidInputError, match="rate: must be a positive"):
        Timeline(0, 0, rate=0.0)
