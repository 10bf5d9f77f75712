# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""One topic that is recorded, whichever way its messages come: none twice, and losses counted."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import pytest

from hapticmech_ros.nodes.bags import recorded_topic
from hapticmech_ros.nodes.bags.recorded_topic import UNDERWAY_S, RecordedTopic
from hapticmech_ros.nodes.sources import Origin


class Kept:
    """A spool, an exchange and a node in one: what was put, and who listens."""

    def __init__(self) -> None:
        self.put_in: list[bytes] = []

    def put(self, name: str, messages: Sequence[tuple[int, bytes]]) -> None:
        self.put_in += [data for _, data in messages]

    def add_topic(self, *arguments: Any) -> None:
        """Of a spool."""

    def create_subscription(self, *arguments: Any, **options: Any) -> None:
        """Of a node."""

    def listen_to_all(self, topic: str, listener: Any, kind: str) -> Any:
        return lambda message: False


class Clock:
    now = 100.0

    def monotonic(self) -> float:
        return self.now

    def time_ns(self) -> int:
        return int(self.now * 1e9)


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> Clock:
    made = Clock()
    monkeypatch.setattr(recorded_topic, "time", made)
    return made


def topic(kept: Kept, watched: list[int]) -> RecordedTopic:
    made = RecordedTopic(
        kept,  # type: ignore[arg-type]
        kept,  # type: ignore[arg-type]
        "/v",
        "std_msgs/msg/UInt8",
        lambda info: 1,
        kept,  # type: ignore[arg-type]
        lambda messages: watched.append(messages[-1][0]),
    )
    made.expect(None, None)  # type: ignore[arg-type]
    return made


def brought(number: int) -> dict[str, int]:
    return {"source_timestamp": number, "publication_sequence_number": number}


def test_a_batch_of_which_the_middleware_has_brought_all_is_not_kept_again(clock: Clock) -> None:
    kept, watched = Kept(), list[int]()
    made = topic(kept, watched)
    made._hear_on_lane([(b"a", Origin(1, 1, 1, 5))])
    made._receive(b"b", brought(2))
    made._hear_on_lane([(b"b", Origin(1, 2, 2, 6))])
    assert kept.put_in == [b"a", b"b"]
    assert watched == [5, 1]
    assert (made.count, made.lost) == (2, 0)


def test_what_the_middleware_drops_of_what_the_lane_brings_is_not_lost(clock: Clock) -> None:
    made = topic(Kept(), [])
    made._receive(b"a", brought(1))
    made._hear_on_lane([(bytes([n]), Origin(1, n, n, n)) for n in range(2, 40)])
    made._receive(b"late", brought(40))
    assert made.lost == 0
    made._hear_on_lane([(b"after", Origin(1, 43, 42, 43))])
    assert made.lost == 2


def test_what_the_middleware_drops_counts_again_when_the_lane_has_ended(clock: Clock) -> None:
    made = topic(Kept(), [])
    made._hear_on_lane([(b"a", Origin(1, 1, 1, 1))])
    made._receive(b"b", brought(2))
    clock.now += 2 * UNDERWAY_S
    made._receive(b"c", brought(6))
    assert made.lost == 3
