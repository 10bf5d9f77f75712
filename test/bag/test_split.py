# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Bags of several files: names, metadata, and reading them as one."""

from __future__ import annotations

from pathlib import Path

import pytest
from mcap.reader import make_reader
from rosbags.rosbag2 import Reader

from bag.record import MS, SUFFIXES, WRENCH, Bytes, metadata, times
from hapticmech_ros.bag import BagReader, BagWriter
from hapticmech_ros.errors import BagError

COUNT = 2500


def write(path: Path, storage: str, make: Bytes, **limits: int) -> None:
    with BagWriter(path, storage, **limits) as bag:
        bag.add_topic("/f", WRENCH)
        bag.add_topic("/latched", "std_msgs/msg/UInt8", "latched")
        for i in range(COUNT):
            bag.write("/f", i * MS, make(i, float(i)))


@pytest.mark.parametrize("storage", SUFFIXES)
def test_splits_by_duration(storage: str, tmp_path: Path, wrench_bytes: Bytes) -> None:
    write(tmp_path / "run", storage, wrench_bytes, split_ns=1000 * MS)
    names = [f"run_{k}{SUFFIXES[storage]}" for k in range(3)]
    assert sorted(p.name for p in (tmp_path / "run").iterdir()) == ["metadata.yaml", *names]
    found = metadata(tmp_path / "run")
    assert found["relative_file_paths"] == names
    starts = [entry["starting_time"]["nanoseconds_since_epoch"] for entry in found["files"]]
    assert starts == [0, 1001 * MS, 2002 * MS]
    assert [entry["message_count"] for entry in found["files"]] == [1001, 1001, 498]
    lasting = [entry["duration"]["nanoseconds"] for entry in found["files"]]
    assert lasting == [1000 * MS, 1000 * MS, 497 * MS]
    assert found["message_count"] == COUNT
    assert times(tmp_path / "run") == [i * MS for i in range(COUNT)]
    with BagReader(tmp_path / "run") as bag:
        assert bag.topics["/latched"].count == 0
    with BagReader(tmp_path / "run" / names[1]) as alone:
        assert alone.topics["/f"].count == 1001
        assert alone.span_ns == (1001 * MS, 2001 * MS)


@pytest.mark.parametrize("storage", SUFFIXES)
def test_splits_by_size(storage: str, tmp_path: Path, wrench_bytes: Bytes) -> None:
    limit = 100_000
    write(tmp_path / "run", storage, wrench_bytes, split_bytes=limit)
    files = sorted((tmp_path / "run").glob(f"*{SUFFIXES[storage]}"))
    assert len(files) == len(metadata(tmp_path / "run")["files"]) > 2
    # An index and, in SQLite, half-filled pages come on top of messages.
    for file in files[:-1]:
        assert limit / 2 < file.stat().st_size < 2.5 * limit
    with Reader(tmp_path / "run") as bag:
        assert [time for _, time, _ in bag.messages()] == [i * MS for i in range(COUNT)]


def test_mcap_packages_read_every_file(tmp_path: Path, wrench_bytes: Bytes) -> None:
    write(tmp_path / "run", "mcap", wrench_bytes, split_ns=1000 * MS)
    received = []
    for number in range(3):
        with (tmp_path / "run" / f"run_{number}.mcap").open("rb") as file:
            reader = make_reader(file, validate_crcs=True)
            summary = reader.get_summary()
            assert {c.topic for c in summary.channels.values()} == {"/f", "/latched"}
            received += [message.log_time for _, _, message in reader.iter_messages()]
    assert received == [i * MS for i in range(COUNT)]


@pytest.mark.parametrize("storage", SUFFIXES)
def test_orders_messages_around_the_end_of_a_file(
    storage: str, tmp_path: Path, wrench_bytes: Bytes
) -> None:
    received = [0, 10, 30, 20, 40]
    with BagWriter(tmp_path / "run", storage) as bag:
        bag.add_topic("/f", WRENCH)
        for number, time_ns in enumerate(received):
            if number == 3:
                bag.split()
            bag.write("/f", time_ns, wrench_bytes(time_ns, 0.0))
    with BagReader(tmp_path / "run") as reader:
        assert [time for _, time, _ in reader.serialized()] == sorted(received)
        assert [t for _, t, _ in reader.serialized(start_ns=20, stop_ns=40)] == [20, 30]


@pytest.mark.parametrize("limits", [{"split_bytes": 0}, {"split_ns": -1}])
def test_refuses_limits_that_are_not_positive(limits: dict[str, int], tmp_path: Path) -> None:
    with pytest.raises(BagError, match="must be positive"):
        BagWriter(tmp_path / "run", **limits)
    assert not (tmp_path / "run").exists()
