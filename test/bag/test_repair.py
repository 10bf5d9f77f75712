# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Bags of writers that were killed, and files that were cut: what is recovered, and what is not."""

from __future__ import annotations

import hashlib
import subprocess
import sys
from pathlib import Path

import pytest
from mcap.reader import make_reader
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

from bag.record import MS, SUFFIXES, WRENCH, Bytes, record, times
from hapticmech_ros.bag import BagReader
from hapticmech_ros.bag.repair import repair
from hapticmech_ros.bag.writer import FLUSH_NS
from hapticmech_ros.errors import BagError

KILLED = """
import os, signal, sys
from hapticmech_ros.bag import BagWriter
path, storage, count = sys.argv[1], sys.argv[2], int(sys.argv[3])
writer = BagWriter(path, storage, split_ns=2_000_000_000)
writer.add_topic("/early", "std_msgs/msg/UInt8", "latched")
for i in range(count):
    if i == count // 2:
        writer.add_topic("/late", "std_msgs/msg/UInt8")
    name = "/late" if i > count // 2 and i % 2 else "/early"
    writer.write(name, i * 1_000_000, bytes((0, 1, 0, 0, i % 256)))
os.kill(os.getpid(), signal.SIGKILL)
"""


def contents(folder: Path) -> dict[str, str]:
    return {p.name: hashlib.sha256(p.read_bytes()).hexdigest() for p in folder.iterdir()}


def write(path: Path, storage: str, make: Bytes, count: int = 3000, split: int = 0) -> None:
    sent = [("/f", i * MS, make(i, float(i))) for i in range(count)]
    record(path, sent, storage, qos="latched", split_ns=split or None)


@pytest.mark.parametrize("storage", SUFFIXES)
def test_kill_costs_half_a_second_at_most(storage: str, tmp_path: Path) -> None:
    count = 5300
    command = [sys.executable, "-c", KILLED, str(tmp_path / "bag"), storage, str(count)]
    assert subprocess.run(command, check=False, timeout=60).returncode == -9
    with pytest.raises(BagError, match="hapticmech bag repair"):
        BagReader(tmp_path / "bag")
    before = contents(tmp_path / "bag")
    report = repair(tmp_path / "bag")
    assert contents(tmp_path / "bag") == before
    assert report.path == tmp_path / "bag_repaired"
    got = times(report.path)
    assert got == [i * MS for i in range(len(got))]
    assert len(got) * MS >= count * MS - FLUSH_NS
    assert report.messages == len(got)
    with BagReader(report.path) as bag:
        assert bag.topics["/late"].count > 1000
        (offer,) = bag.topics["/early"].offered
        assert offer.durability.name == "TRANSIENT_LOCAL"
        assert all(data[4] == time // MS % 256 for _, time, data in bag.serialized())


@pytest.mark.parametrize("share", [0.3, 0.7, 0.95, 0.999])
def test_cut_mcap(share: float, tmp_path: Path, wrench_bytes: Bytes) -> None:
    write(tmp_path / "bag", "mcap", wrench_bytes)
    file = tmp_path / "bag" / "bag_0.mcap"
    size = file.stat().st_size
    file.write_bytes(file.read_bytes()[: int(share * size)])
    report = repair(tmp_path / "bag", tmp_path / "new" / "one")
    got = times(tmp_path / "new" / "one")
    # Whole messages of the chunk that was cut are there too; the index takes a part of the file.
    assert got == [i * MS for i in range(len(got))]
    assert len(got) >= int(share * 3000) * 0.95
    assert report.files[0].trouble
    with (tmp_path / "new" / "one" / "one_0.mcap").open("rb") as stream:
        assert sum(1 for _ in make_reader(stream).iter_messages()) == len(got)


def test_cut_within_a_chunk_keeps_its_whole_messages(tmp_path: Path, wrench_bytes: Bytes) -> None:
    write(tmp_path / "bag", "mcap", wrench_bytes, count=400)
    file = tmp_path / "bag" / "bag_0.mcap"
    record = 9 + 22 + len(wrench_bytes(0, 0.0))
    data = file.read_bytes()
    place = data.index(wrench_bytes(399, 399.0))
    file.write_bytes(data[: place - 9 - 22 + record - 1])
    assert repair(tmp_path / "bag").messages == 399


def test_mcap_chunk_that_cannot_be_read_costs_itself_only(
    tmp_path: Path, wrench_bytes: Bytes
) -> None:
    writer = Writer(tmp_path / "other", version=9, storage_plugin=StoragePlugin.MCAP)
    writer.set_compression(CompressionMode.STORAGE, CompressionFormat.ZSTD)
    store = get_typestore(Stores.ROS2_JAZZY)
    with writer:
        connection = writer.add_connection("/f", WRENCH, typestore=store)
        for i in range(30_000):
            writer.write(connection, i * MS, wrench_bytes(i, float(i)))
    file = tmp_path / "other" / "other.mcap"
    data = bytearray(file.read_bytes())
    magic = bytes.fromhex("28b52ffd")
    second = data.index(magic, data.index(magic) + 1)
    data[second : second + 4] = b"oops"
    file.write_bytes(data)
    report = repair(tmp_path / "other")
    assert 15_000 < report.messages < 30_000
    assert report.lost_bytes > 1000
    assert times(report.path)[-1] == 29_999 * MS


@pytest.mark.parametrize("storage", SUFFIXES)
def test_only_the_last_of_several_files_is_damaged(
    storage: str, tmp_path: Path, wrench_bytes: Bytes
) -> None:
    write(tmp_path / "bag", storage, wrench_bytes, split=1000 * MS)
    suffix = "mcap" if storage == "mcap" else "db3"
    last = tmp_path / "bag" / f"bag_2.{suffix}"
    last.write_bytes(last.read_bytes()[: last.stat().st_size // 2])
    report = repair(tmp_path / "bag")
    assert [file.trouble == "" for file in report.files] == [True, True, False]
    assert [file.messages for file in report.files[:2]] == [1001, 1001]
    assert times(report.path)[:2002] == [i * MS for i in range(2002)]
    assert report.stated == 3000 > report.messages >= 2002


def test_a_type_that_nobody_here_knows_survives(tmp_path: Path) -> None:
    with Writer(tmp_path / "bag", version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        connection = writer.add_connection(
            "/odd", "odd_msgs/msg/Odd", msgdef="uint8 value\n", rihs01="RIHS01_" + "0" * 64
        )
        writer.write(connection, 5, b"\x00\x01\x00\x00\x07")
    report = repair(tmp_path / "bag")
    assert report.counts == {"/odd": 1}
    with (report.path / "bag_repaired_0.mcap").open("rb") as stream:
        ((schema, _, message),) = list(make_reader(stream).iter_messages())
    assert (schema.name, schema.data) == ("odd_msgs/msg/Odd", b"uint8 value\n")
    assert message.data == b"\x00\x01\x00\x00\x07"


@pytest.mark.parametrize("storage", SUFFIXES)
def test_a_file_of_nonsense(storage: str, tmp_path: Path, wrench_bytes: Bytes) -> None:
    write(tmp_path / "bag", storage, wrench_bytes, count=20)
    (file,) = [p for p in (tmp_path / "bag").iterdir() if p.suffix in (".mcap", ".db3")]
    file.write_bytes(b"nonsense" * 1000)
    report = repair(tmp_path / "bag")
    assert report.messages == 0
    assert report.lost_bytes == 8000
    assert report.files[0].trouble


def test_never_overwrites_and_says_what_it_needs(tmp_path: Path, wrench_bytes: Bytes) -> None:
    with pytest.raises(BagError, match="no bag at"):
        repair(tmp_path / "nowhere")
    (tmp_path / "empty").mkdir()
    with pytest.raises(BagError, match="nothing to repair"):
        repair(tmp_path / "empty")
    write(tmp_path / "bag", "mcap", wrench_bytes, count=20)
    (tmp_path / "bag_repaired").mkdir()
    with pytest.raises(BagError, match="exists already"):
        repair(tmp_path / "bag")
    (tmp_path / "bag" / "bag_1.db3").write_bytes(b"")
    with pytest.raises(BagError, match="both storages"):
        repair(tmp_path / "bag", tmp_path / "other")
