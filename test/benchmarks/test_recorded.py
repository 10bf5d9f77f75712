# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A bag written by hand gives back the latencies and losses that were put into it."""

from pathlib import Path

import numpy as np
import pytest

from benchmarks.graph.recorded import ASKED, LOST, RECORDED_TRIP, UNSEEN, losses, recorded
from benchmarks.graph.statuses import latency
from hapticmech_ros.bag.writer import BagWriter
from hapticmech_ros.wire.cdr import FlatArray
from hapticmech_ros.wire.topics import (
    DEVICE_COMMAND,
    DEVICE_STATE,
    POINT_COMMAND,
    POINT_MODEL,
    STATE,
    Topic,
)

BEGUN_NS, PERIOD_NS, COUNT = 1_700_000_000_000_000_000, 1_000_000, 100
WINDOW = BEGUN_NS, BEGUN_NS + COUNT * PERIOD_NS
# µs after the stamp at which the recorder gets each topic.
DELAYS_US = {
    DEVICE_STATE: 100,
    DEVICE_COMMAND: 350,
    POINT_COMMAND: 360,
    STATE: 120,
    POINT_MODEL: 500,
}
UNANSWERED = {DEVICE_COMMAND: {3, 50}, POINT_COMMAND: {3}, POINT_MODEL: {7}, STATE: {9}}


def wrench(stamp_ns: int) -> bytes:
    seconds, rest = divmod(stamp_ns, 1_000_000_000)
    header = np.array([seconds, rest, 6], dtype="<u4").tobytes() + b"world\0\0\0"
    return b"\x00\x01\x00\x00" + header + b"\0" * (-len(header) % 8) + np.zeros(6).tobytes()


def array(stamp_ns: int) -> bytes:
    return FlatArray({"stamp": 2, "rest": 3}).encode(
        np.array([*divmod(stamp_ns, 1_000_000_000), 1.0, 2.0, 3.0])
    )


@pytest.fixture
def bag(tmp_path: Path) -> Path:
    path = tmp_path / "bag"
    messages: list[tuple[int, Topic, bytes]] = []
    for number in range(-10, COUNT + 10):
        stamp = BEGUN_NS + number * PERIOD_NS
        for topic, delay_us in DELAYS_US.items():
            if number not in UNANSWERED.get(topic, ()):
                data = wrench(stamp) if "Wrench" in topic.type else array(stamp)
                messages.append((stamp + 1000 * delay_us, topic, data))
    with BagWriter(path) as writer:
        for topic in DELAYS_US:
            writer.add_topic(f"/{topic.of('handle')}", topic.type, topic.qos)
        for time_ns, topic, data in sorted(messages, key=lambda item: item[0]):
            writer.write(f"/{topic.of('handle')}", time_ns, data)
    return path


def test_latencies_are_those_put_in(bag: Path) -> None:
    found = recorded(bag, "handle", WINDOW).figures
    for hop, delay_us in (
        (RECORDED_TRIP, DELAYS_US[DEVICE_COMMAND]),
        ("device/state → servo_cf", 350 - 100),
        ("mechanism/state → operational_model", 500 - 120),
    ):
        assert {found[latency(hop, one)] for one in ("p50", "p90", "p99", "max")} == {delay_us}


def test_losses_are_those_put_in(bag: Path) -> None:
    found = recorded(bag, "handle", WINDOW).figures
    assert [value for name, value in found.items() if name.endswith(LOST)] == [2, 1, 1]
    asked = [value for name, value in found.items() if name.endswith(ASKED)]
    assert asked == [COUNT, COUNT, COUNT - 1]
    # The state that is missing was answered: the recorder lost it.
    assert [value for name, value in found.items() if name.endswith(UNSEEN)] == [0, 0, 1]


def test_each_message_counts_once_and_in_the_window_alone() -> None:
    asked = [*range(1000, 2000, 10), 999, 2000]
    answers = [stamp for stamp in asked if stamp not in (1000, 1500, 1990)]
    assert list(losses("it", asked, [*answers, *answers], (1000, 2000)).values()) == [100, 3, 0]


def test_messages_are_counted_in_the_window_and_measured_in_the_whole_bag(bag: Path) -> None:
    found = recorded(bag, "handle", WINDOW)
    assert found.published["/device/state"] == COUNT
    assert found.sizes["/device/state"] == len(array(0))
    assert found.sizes["/device/servo_cf"] == len(wrench(0))
    empty = recorded(bag, "handle", (0, 1))
    assert empty.published == {}
    assert not any(empty.figures.values())
    assert empty.sizes == found.sizes
