# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Bags that BagWriter writes, read by rosbags, by mcap's own packages and by SQLite."""

from __future__ import annotations

import sqlite3
import threading
from collections.abc import Callable
from pathlib import Path

import pytest
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory

from bag.record import SUFFIXES, WRENCH, Bytes, times
from hapticmech_ros.bag import BagReader, BagWriter
from hapticmech_ros.bag.check import inspect_bag
from hapticmech_ros.bag.metadata import load_metadata, losses_of
from hapticmech_ros.errors import BagError
from hapticmech_ros.wire.topics import TOPICS

TIMES = (10**18 + 5, 10**18 + 1_000_005, 10**18 + 2_000_005)


def write(path: Path, storage: str, wrench_bytes: Bytes) -> list[bytes]:
    sent = [wrench_bytes(time_ns, 0.1 * i) for i, time_ns in enumerate(TIMES)]
    with BagWriter(path, storage) as bag:
        bag.add_topic("/a/force", WRENCH, "stream")
        bag.add_topic("/a/closures", "std_msgs/msg/UInt8MultiArray", "latched")
        for time_ns, data in zip(TIMES, sent, strict=True):
            bag.write("/a/force", time_ns, data)
        assert bag.counts == {"/a/force": 3, "/a/closures": 0}
    return sent


def test_mcap_packages_decode_it(tmp_path: Path, wrench_bytes: Bytes) -> None:
    write(tmp_path / "bag", "mcap", wrench_bytes)
    with (tmp_path / "bag" / "bag_0.mcap").open("rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        found = [
            (channel.topic, schema.name, message.log_time, decoded)
            for schema, channel, message, decoded in reader.iter_decoded_messages()
        ]
    assert [(topic, kind, time) for topic, kind, time, _ in found] == [
        ("/a/force", WRENCH, time) for time in TIMES
    ]
    for index, (*_, decoded) in enumerate(found):
        force = decoded.wrench.force
        assert (force.x, force.y, force.z) == (0.1 * index, 2 * 0.1 * index, -0.1 * index)
        stamp = decoded.header.stamp
        assert stamp.sec * 1_000_000_000 + stamp.nanosec == TIMES[index]
        assert decoded.header.frame_id == "world"


def test_sqlite_file_needs_no_journal_once_it_is_closed(
    tmp_path: Path, wrench_bytes: Bytes
) -> None:
    write(tmp_path / "bag", "sqlite3", wrench_bytes)
    assert sorted(p.name for p in (tmp_path / "bag").iterdir()) == ["bag_0.db3", "metadata.yaml"]
    # Versions of writing and reading in SQLite's header: 1 without, 2 with a write-ahead log, which
    # nobody can open who may not write.
    assert (tmp_path / "bag" / "bag_0.db3").read_bytes()[18:20] == b"\x01\x01"


@pytest.mark.parametrize("storage", SUFFIXES)
def test_other_threads_may_write(storage: str, tmp_path: Path, wrench_bytes: Bytes) -> None:
    bag = BagWriter(tmp_path / "bag", storage)
    bag.add_topic("/f", WRENCH)
    data = wrench_bytes(1, 1.0)
    failures: list[Exception] = []

    def work(first: int) -> None:
        try:
            for i in range(200):
                bag.write("/f", first + i, data)
        except (BagError, sqlite3.Error) as error:
            failures.append(error)

    threads = [threading.Thread(target=work, args=(1000 * k,)) for k in range(3)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    bag.close()
    assert not failures
    assert times(tmp_path / "bag") == sorted(1000 * k + i for k in range(3) for i in range(200))


@pytest.mark.parametrize("storage", SUFFIXES)
def test_every_topic_of_the_graph_can_be_recorded(storage: str, tmp_path: Path) -> None:
    with BagWriter(tmp_path / "bag", storage) as bag:
        for topic in TOPICS:
            bag.add_topic("/" + topic.of("handle").lstrip("/"), topic.type, topic.qos)
    with BagReader(tmp_path / "bag") as reader:
        assert len(reader.topics) == len(TOPICS)
        assert reader.span_ns == (0, 0)
        assert list(reader.messages()) == []


def test_never_overwrites(tmp_path: Path) -> None:
    (tmp_path / "kept").write_text("precious")
    for path in (tmp_path, tmp_path / "kept"):
        with pytest.raises(BagError, match="exists already"):
            BagWriter(path)
    assert (tmp_path / "kept").read_text() == "precious"


def test_refuses_unknown_storage_and_leaves_nothing(tmp_path: Path) -> None:
    with pytest.raises(BagError, match=r"storage 'tape': must be one of mcap, sqlite3"):
        BagWriter(tmp_path / "bag", "tape")
    assert not (tmp_path / "bag").exists()


@pytest.mark.parametrize(
    ("refused", "rule"),
    [
        (lambda bag: bag.add_topic("/f", WRENCH), "topic /f is already there"),
        (lambda bag: bag.add_topic("/g", "x_msgs/msg/Y"), "'x_msgs/msg/Y' of /g: not a message"),
        (lambda bag: bag.add_topic("/h", WRENCH, "best"), "quality of service 'best'"),
        (lambda bag: bag.write("/g", 1, b""), "topic /g was not announced"),
    ],
)
def test_refuses_what_it_was_not_told(
    tmp_path: Path, refused: Callable[[BagWriter], None], rule: str
) -> None:
    with BagWriter(tmp_path / "bag") as bag:
        bag.add_topic("/f", WRENCH)
        with pytest.raises(BagError, match=rule):
            refused(bag)


@pytest.mark.parametrize("storage", SUFFIXES)
def test_closes_once(storage: str, tmp_path: Path, wrench_bytes: Bytes) -> None:
    bag = BagWriter(tmp_path / "bag", storage)
    bag.add_topic("/f", WRENCH)
    bag.close()
    bag.close()
    with pytest.raises(BagError, match="is closed"):
        bag.write("/f", 1, wrench_bytes(1, 1.0))
    with pytest.raises(BagError, match="is closed"):
        bag.add_topic("/g", WRENCH)


@pytest.mark.parametrize("storage", SUFFIXES)
def test_an_error_does_not_cost_the_recording(
    storage: str, tmp_path: Path, wrench_bytes: Bytes
) -> None:
    def fail() -> None:
        with BagWriter(tmp_path / "bag", storage) as bag:
            bag.add_topic("/f", WRENCH)
            bag.write("/f", 7, wrench_bytes(1, 1.0))
            raise RuntimeError("stop")

    with pytest.raises(RuntimeError, match="stop"):
        fail()
    assert times(tmp_path / "bag") == [7]


@pytest.mark.parametrize("storage", SUFFIXES)
def test_many_messages_at_once_are_as_good_as_one_by_one(
    tmp_path: Path, storage: str, wrench_bytes: Bytes
) -> None:
    sent = write(tmp_path / "ones", storage, wrench_bytes)
    with BagWriter(tmp_path / "many", storage) as bag:
        bag.add_topic("/a/force", WRENCH, "stream")
        bag.add_topic("/a/closures", "std_msgs/msg/UInt8MultiArray", "latched")
        bag.write_many("/a/force", list(zip(TIMES, sent, strict=True)))
        bag.write_many("/a/closures", [])
        assert bag.counts == {"/a/force": 3, "/a/closures": 0}
    if storage == "mcap":
        one, many = (tmp_path / name / f"{name}_0.mcap" for name in ("ones", "many"))
        assert one.read_bytes().replace(b"ones_0", b"many_0") == many.read_bytes()
    with BagReader(tmp_path / "many") as bag:
        assert [(time_ns, data) for _, time_ns, data in bag.serialized()] == list(
            zip(TIMES, sent, strict=True)
        )


@pytest.mark.parametrize("storage", SUFFIXES)
def test_a_bag_says_what_its_recording_lost(tmp_path: Path, storage: str) -> None:
    lost = {"/a/force": 12, "/a/closures": 0, "/rosout": None}
    writer = BagWriter(tmp_path / "bag", storage)
    writer.add_topic("/a/force", WRENCH, "stream")
    writer.close(lost)
    information = load_metadata(tmp_path / "bag")
    # Texts, as rosbag2 reads them.
    told = {"lost": "12", "lost /a/force": "12", "lost /rosout": "unknown"}
    assert information["custom_data"] == told
    assert losses_of(information) == {"/a/force": 12, "/rosout": None}
    assert inspect_bag(tmp_path / "bag").lost == {"/a/force": 12, "/rosout": None}
    BagWriter(tmp_path / "nobody", storage).close()
    assert losses_of(load_metadata(tmp_path / "nobody")) is None
    BagWriter(tmp_path / "none", storage).close({"/a/force": 0})
    assert losses_of(load_metadata(tmp_path / "none")) == {}
