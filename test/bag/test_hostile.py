# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Bags that somebody wrote to do harm: each ends in a sentence, in bounded memory and time."""

from __future__ import annotations

import os
import shutil
import sqlite3
import struct
import sys
from collections.abc import Callable
from pathlib import Path

import lz4.frame
import pytest

from bag.record import Bytes
from bag.record import record as recorded
from hapticmech_ros.bag import BagReader, storage
from hapticmech_ros.bag.check import check, inspect_bag
from hapticmech_ros.bag.metadata import load_metadata
from hapticmech_ros.bag.repair import repair, repair_in_child
from hapticmech_ros.bag.storage import unpack_file, unpacked
from hapticmech_ros.errors import BagError, FileError, HapticMechError

if sys.version_info >= (3, 14):
    from compression import zstd
else:
    from backports import zstd

MAGIC = b"\x89MCAP0\r\n"
ENDLESS = "WITH RECURSIVE c(x) AS (SELECT 1 UNION ALL SELECT x + 1 FROM c)"
MERGES = "".join([f"a{k}: &a{k} {{<<: [{', '.join([f'*a{k - 1}'] * 9)}]}}\n" for k in range(1, 12)])
BOMB = "a0: &a0 {x: 1, y: 2}\n" + MERGES


def text(value: str) -> bytes:
    return struct.pack("<I", len(value.encode())) + value.encode()


def record(kind: int, content: bytes) -> bytes:
    return struct.pack("<BQ", kind, len(content)) + content


def chunk(records: bytes, compression: str, size: int) -> bytes:
    head = struct.pack("<QQQI", 0, 1, size, 0) + text(compression)
    return record(6, head + struct.pack("<Q", len(records)) + records)


def mcap(path: Path, records: bytes) -> Path:
    """Write a file without an index."""
    end = record(0x0F, bytes(4)) + record(2, bytes(20)) + MAGIC
    path.write_bytes(MAGIC + record(1, text("ros2") + text("x")) + records + end)
    return path


def channel(offered: str, definition: str = "uint8 data") -> bytes:
    notes = text("offered_qos_profiles") + text(offered)
    schema = struct.pack("<H", 1) + text("std_msgs/msg/UInt8") + text("ros2msg") + text(definition)
    head = struct.pack("<HH", 1, 1) + text("/a") + text("cdr")
    return record(3, schema) + record(4, head + struct.pack("<I", len(notes)) + notes)


def outcome(path: Path) -> str:
    """Return the first sentence of all that reads bags; none is more than one."""
    said = [*check(path).damage]
    try:
        inspect_bag(path)
    except HapticMechError as error:
        said.append(str(error))
    # What the child does, without one for each of so many bags.
    scratch = path.parent / "scratch"
    scratch.mkdir(exist_ok=True)
    shutil.rmtree(scratch / "repaired", ignore_errors=True)
    item = {"source": str(path), "target": str(scratch / "repaired"), "scratch": str(scratch)}
    done = repair_in_child(item)
    said += [done["error"]] if "error" in done else [file["trouble"] for file in done["files"]]
    assert all("Traceback" not in one and "\n" not in one for one in said)
    return " | ".join(said)


def zeros(compression: str) -> bytes:
    data = bytes(300 << 20)
    return zstd.compress(data) if compression == "zstd" else bytes(lz4.frame.compress(data))


@pytest.mark.parametrize("compression", ["zstd", "lz4"])
def test_what_unpacks_to_more_than_it_says_is_not_unpacked(
    tmp_path: Path, compression: str
) -> None:
    packed = zeros(compression)
    for size, rule in ((1000, "become more than 1000 bytes"), (1 << 40, "a chunk has at most")):
        folder = tmp_path / str(size)
        folder.mkdir()
        found = outcome(mcap(folder / "bag.mcap", chunk(packed, compression, size)))
        assert rule in found
    with pytest.raises(Exception, match="become more than 268435456 bytes"):
        unpacked(packed, compression)


@pytest.mark.parametrize("compression", ["zstd", "lz4"])
def test_frames_are_unpacked_as_they_were(compression: str) -> None:
    data = os.urandom(100_000)
    pack = zstd.compress if compression == "zstd" else lz4.frame.compress
    assert unpacked(pack(data) + pack(b"") + pack(data), compression) == data + data
    assert unpacked(pack(data), compression, len(data)) == data
    for bad in (pack(data)[:-1], b"x" * 100, pack(data) + b"x" * 100):
        with pytest.raises(Exception, match=r"damaged|break off"):
            unpacked(bad, compression)


def test_a_file_is_unpacked_to_its_limit(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(storage, "UNPACKED_LIMIT", 1 << 20)
    file = tmp_path / "bag.mcap.zstd"
    file.write_bytes(zstd.compress(bytes(8 << 20)))
    assert "becomes more than" in unpack_file(file, tmp_path / "plain")
    assert (tmp_path / "plain").stat().st_size <= 3 << 20


def test_chunks_in_chunks_and_records_that_never_end(tmp_path: Path) -> None:
    inner = chunk(b"", "", 0)
    for _ in range(50):
        inner = chunk(inner * 2, "", 2 * len(inner)) if len(inner) < 1 << 20 else inner
    assert "within a chunk" in outcome(mcap(tmp_path / "nested.mcap", inner))
    whole = chunk(chunk(b"", "", 0) * 2, "", 1000)
    cut = struct.pack("<BQ", 6, len(whole) + 50) + whole[9:]
    (tmp_path / "cut.mcap").write_bytes(MAGIC + record(1, text("ros2") + text("x")) + cut)
    assert "within a chunk" in outcome(tmp_path / "cut.mcap")
    endless = struct.pack("<BQ", 6, 1 << 62) + b"x" * 100
    assert "breaks off" in outcome(mcap(tmp_path / "endless.mcap", endless))


@pytest.mark.parametrize(
    "offered",
    [BOMB, "'" * 3, "- {}", "- 1", "5", "[" * 1000, "- history: []", "'- {}'", "- depth: -1"],
)
def test_profiles_that_are_none(tmp_path: Path, offered: str) -> None:
    path = mcap(tmp_path / "bag.mcap", channel(offered))
    assert "offered_qos_profiles cannot be read" in outcome(path)


def test_definitions_that_take_long_to_understand(tmp_path: Path) -> None:
    """A file of 300 kB that would take seconds; larger ones would take minutes."""
    path = mcap(tmp_path / "bag.mcap", channel("", definition="uint8 data" + "\n" * 300_000))
    with pytest.raises(BagError, match="at most 4000000 characters in 200000 lines"):
        BagReader(path)


def test_times_beyond_64_bits_with_a_sign(tmp_path: Path) -> None:
    message = record(5, struct.pack("<HIQQ", 1, 0, 1 << 63, 0) + bytes((0, 1, 0, 0, 7)))
    path = mcap(tmp_path / "bag.mcap", channel("") + message)
    assert f"of {1 << 63} ns" in outcome(path)


@pytest.fixture
def stored(tmp_path: Path, wrench_bytes: Bytes) -> Path:
    """A sound bag in SQLite."""
    sent = [("/f", number, wrench_bytes(number, 1.0)) for number in range(50)]
    return recorded(tmp_path / "bag", sent, "sqlite3")


def changed(bag: Path, script: str) -> Path:
    (file,) = bag.glob("*.db3")
    with sqlite3.connect(file) as database:
        database.executescript(script)
    database.close()
    return file


STRANGE = {
    "endless view": f"DROP TABLE messages; CREATE VIEW messages AS {ENDLESS}"
    " SELECT x AS id, 1 AS topic_id, x AS timestamp, x'00' AS data FROM c;",
    "endless topics": f"DROP TABLE topics; CREATE VIEW topics AS {ENDLESS} SELECT x AS id,"
    " 'a' AS name, 'b' AS type, 'cdr' AS serialization_format, '' AS offered_qos_profiles,"
    " '' AS type_description_hash FROM c;",
    "trigger": "CREATE TRIGGER t AFTER INSERT ON messages BEGIN DELETE FROM topics; END;",
    "computed": "DROP TABLE messages; CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id"
    " INTEGER, timestamp INTEGER, data BLOB AS (zeroblob(1000000000)));"
    " INSERT INTO messages(topic_id, timestamp) VALUES (1, 1);",
    "virtual": "CREATE VIRTUAL TABLE v USING fts5(a);",
    "no topics": "DROP TABLE topics;",
}


@pytest.mark.parametrize("name", STRANGE)
@pytest.mark.parametrize("alone", [True, False], ids=["file", "folder"])
def test_tables_that_are_no_plain_ones(stored: Path, name: str, alone: bool) -> None:
    file = changed(stored, STRANGE[name])
    found = outcome(file if alone else stored)
    assert "plain tables" in found or "computed columns" in found or "no tables" in found


TYPES = [
    *(f"UPDATE topics SET {column} = {value}" for column in ("name", "type", "offered_qos_profiles",
      "type_description_hash", "serialization_format") for value in ("x'ff'",)),
    *(f"UPDATE message_definitions SET {column} = x'ff'" for column in
      ("topic_type", "encoding", "encoded_message_definition")),
    "UPDATE topics SET name = CAST(x'fffe' AS TEXT)",
    "UPDATE message_definitions SET encoded_message_definition = 'x'",
    "UPDATE message_definitions SET encoding = 'other'",
    *(f"UPDATE messages SET {column} = 'x'" for column in ("topic_id", "timestamp", "data")),
    "UPDATE messages SET timestamp = -5",
    "UPDATE messages SET timestamp = 1.5",
    "DELETE FROM schema",
    "UPDATE messages SET data = zeroblob(0)",
]  # fmt: skip


HARMLESS = ("DELETE FROM schema", "UPDATE message_definitions SET encoding = 'other'")


@pytest.mark.parametrize("script", TYPES)
@pytest.mark.parametrize("alone", [True, False], ids=["file", "folder"])
def test_values_of_another_type(stored: Path, script: str, alone: bool) -> None:
    """None of them is more than damage; messages of no topic are left out, as SQLite says."""
    file = changed(stored, script)
    found = outcome(file if alone else stored)
    harmless = script in HARMLESS or (alone and "SET topic_id" in script)
    assert bool(found.strip(" |")) is not harmless


def said(bag: Path, old: str, new: str) -> Path:
    path = bag / "metadata.yaml"
    whole = path.read_text()
    assert old in whole
    path.write_text(whole.replace(old, new))
    return bag


METADATA = {
    "outside": ("- bag_0.db3", "- ../other/bag_0.db3", "must be a file in the bag's folder"),
    "absolute": ("- bag_0.db3", "- /etc/passwd", "must be a file in the bag's folder"),
    "above": ("- bag_0.db3", "- ..", "must be a file in the bag's folder"),
    "too long": ("- bag_0.db3", f"- {'x' * 5000}", "files are missing"),
    "zero byte": ("- bag_0.db3", '- "a\\0b"', "must be a file in the bag's folder"),
    "merges": ("rosbag2_bagfile_information:", f"{BOMB}rosbag2_bagfile_information:", "aliases"),
    "binary": ("message_count: 50", "message_count: 0b", "message_count"),
    "huge": ("message_count: 50", f"message_count: {10**30}", "message_count"),
    "negative": ("message_count: 50", "message_count: -1", "message_count"),
    "words": ("nanoseconds: 49", "nanoseconds: many", "nanoseconds"),
    "list": ("ros_distro: jazzy", "ros_distro: [a]", "ros_distro"),
    "version": ("version: 9", "version: 1e99", "version"),
    "storage": ("storage_identifier: sqlite3", "storage_identifier: [a]", "storage_identifier"),
}


@pytest.mark.parametrize(("old", "new", "rule"), METADATA.values(), ids=METADATA)
def test_metadata_that_lie(stored: Path, old: str, new: str, rule: str) -> None:
    said(stored, old, new)
    (stored.parent / "other").mkdir()
    (stored.parent / "other" / "bag_0.db3").write_bytes((stored / "bag_0.db3").read_bytes())
    with pytest.raises(BagError, match=rule):
        BagReader(stored)
    with pytest.raises(BagError, match=rule):
        inspect_bag(stored)


@pytest.fixture(params=["pipe", "device", "folder"])
def strange(request: pytest.FixtureRequest) -> Callable[[Path], None]:
    def put(path: Path) -> None:
        path.unlink(missing_ok=True)
        if request.param == "pipe":
            os.mkfifo(path)
        elif request.param == "device":
            path.symlink_to("/dev/zero")
        else:
            path.mkdir()

    return put


def test_files_that_are_no_regular_ones(stored: Path, strange: Callable[[Path], None]) -> None:
    strange(stored / "bag_0.db3")
    assert "regular file" in outcome(stored)
    strange(stored / "metadata.yaml")
    with pytest.raises(FileError, match="regular file"):
        load_metadata(stored)
    strange(stored.parent / "alone.mcap")
    assert outcome(stored.parent / "alone.mcap")


@pytest.mark.parametrize("name", ["x" * 300, "x" * 5000, "a\0b"])
def test_names_that_no_bag_can_have(tmp_path: Path, name: str) -> None:
    for read in (BagReader, check, inspect_bag, repair):
        with pytest.raises(BagError, match="no bag at"):
            read(tmp_path / name)
