# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Bags of many writers, whole and with a fault: read whole, or refused; never less in silence."""

from __future__ import annotations

import itertools
import re
import sqlite3
import struct
from collections import Counter
from collections.abc import Callable
from contextlib import closing
from pathlib import Path

import mcap.writer as mcap
import pytest
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer

from bag.record import STORE, record
from bag.record import alone as written_alone
from hapticmech_ros.bag import BagReader
from hapticmech_ros.bag.check import check, inspect_bag
from hapticmech_ros.bag.repair import repair
from hapticmech_ros.errors import BagError
from sampling import sampled

STRING = "std_msgs/msg/String"
TOPICS = ("/f", "/g")
# Messages as CDR: in order, two of them at one time.
TRUTH = [
    (TOPICS[i % 2], 10**18 + 1000 * (i // 2), struct.pack("<4sI3s", b"\0\1\0\0", 3, b"%02d\0" % i))
    for i in range(100)
]
Sortable = list[tuple[str, int, bytes]]


def own(path: Path, storage: str, split: bool = False) -> Path:
    return record(path, TRUTH, storage, STRING, split_ns=20_000 if split else None)


def library(path: Path, plugin: StoragePlugin, version: int, mode: str = "NONE") -> Path:
    bag = Writer(path, version=version, storage_plugin=plugin)  # type: ignore[arg-type]
    if mode != "NONE":
        bag.set_compression(CompressionMode[mode], CompressionFormat.ZSTD)
    with bag:
        topics = {name: bag.add_connection(name, STRING, typestore=STORE) for name in TOPICS}
        for name, time_ns, data in TRUTH:
            bag.write(topics[name], time_ns, data)
    return path


def alone(path: Path, **kinds: object) -> Path:
    return written_alone(path.with_suffix(".mcap"), TRUTH, STRING, **kinds)


def first_tables(path: Path, version: int) -> Path:
    """Write what the first versions of rosbag2 wrote: no QoS, the folder's name before the file."""
    path.mkdir()
    with closing(sqlite3.connect(path / "bag_0.db3")) as database:
        database.execute("CREATE TABLE topics(id, name TEXT, type TEXT, serialization_format TEXT)")
        database.execute("CREATE TABLE messages(id, topic_id, timestamp INTEGER, data BLOB)")
        # Out of order, and one that nothing was recorded of.
        for number, name in ((7, "/g"), (3, "/f"), (5, "/unused")):
            database.execute("INSERT INTO topics VALUES (?, ?, ?, 'cdr')", (number, name, STRING))
        rows = [(i, 3 + 4 * (i % 2), *one[1:]) for i, one in enumerate(TRUTH)]
        database.executemany("INSERT INTO messages VALUES (?, ?, ?, ?)", reversed(rows))
        database.commit()
    topics = "".join(
        f"    - topic_metadata: {{name: {name}, type: {STRING}, serialization_format: cdr}}\n"
        f"      message_count: {count}\n"
        for name, count in (("/f", 50), ("/g", 50), ("/unused", 0))
    )
    file = "bag/bag_0.db3" if version < 4 else "bag_0.db3"
    (path / "metadata.yaml").write_text(
        f"rosbag2_bagfile_information:\n  version: {version}\n  storage_identifier: sqlite3\n"
        f"  relative_file_paths: [{file}]\n  duration: {{nanoseconds: 49000}}\n"
        f"  starting_time: {{nanoseconds_since_epoch: {10**18}}}\n  message_count: 100\n"
        f"  topics_with_message_count:\n{topics}",
        encoding="utf-8",
    )
    return path


WRITERS: dict[str, Callable[[Path], Path]] = {
    "own mcap": lambda path: own(path, "mcap"),
    "own sqlite3": lambda path: own(path, "sqlite3"),
    "own mcap split": lambda path: own(path, "mcap", split=True),
    "own sqlite3 split": lambda path: own(path, "sqlite3", split=True),
    "rosbags 8 sqlite3": lambda path: library(path, StoragePlugin.SQLITE3, 8),
    "rosbags 9 mcap": lambda path: library(path, StoragePlugin.MCAP, 9),
    "rosbags 9 sqlite3 messages": lambda path: library(path, StoragePlugin.SQLITE3, 9, "MESSAGE"),
    "rosbags 9 sqlite3 file": lambda path: library(path, StoragePlugin.SQLITE3, 9, "FILE"),
    "rosbags 9 mcap messages": lambda path: library(path, StoragePlugin.MCAP, 9, "MESSAGE"),
    "rosbags 9 mcap file": lambda path: library(path, StoragePlugin.MCAP, 9, "FILE"),
    "rosbags 9 mcap chunks": lambda path: library(path, StoragePlugin.MCAP, 9, "STORAGE"),
    "mcap zstd": lambda path: alone(path, compression=mcap.CompressionType.ZSTD),
    "mcap loose": lambda path: alone(
        path, use_chunking=False, repeat_channels=False, use_statistics=False
    ),
    "tables 2": lambda path: first_tables(path, 2),
    "tables 4": lambda path: first_tables(path, 4),
}


def files(bag: Path) -> list[Path]:
    """Return the storage files of a bag."""
    inside = sorted(bag.iterdir()) if bag.is_dir() else [bag]
    return [one for one in inside if re.search(r"\.(mcap|db3)(\.zstd)?$", one.name)]


def cut(at: Callable[[int], int]) -> Callable[[Path], None]:
    def fault(bag: Path) -> None:
        file = files(bag)[-1]
        data = file.read_bytes()
        file.write_bytes(data[: at(len(data))])

    return fault


def edit(pattern: str, replacement: str) -> Callable[[Path], None]:
    def fault(bag: Path) -> None:
        file = bag / "metadata.yaml"
        if file.exists():
            text = file.read_text(encoding="utf-8")
            file.write_text(re.sub(pattern, replacement, text), encoding="utf-8")

    return fault


def execute(*statements: str) -> Callable[[Path], None]:
    def fault(bag: Path) -> None:
        if files(bag)[0].suffix == ".db3":
            with closing(sqlite3.connect(files(bag)[0])) as database:
                for statement in statements:
                    database.execute(statement)
                database.commit()

    return fault


def flip(bag: Path) -> None:
    """Change a byte of a message of an mcap file; SQLite has no checksums."""
    file = files(bag)[0]
    data = bytearray(file.read_bytes())
    at = data.find(b"\x03\0\0\0")
    if file.suffix == ".mcap" and b"zstd" in data and at > 0:
        data[len(data) // 4] ^= 0xFF
        file.write_bytes(data)


def beside(ending: str, content: bytes) -> Callable[[Path], None]:
    def fault(bag: Path) -> None:
        files(bag)[0].with_name(files(bag)[0].name + ending).write_bytes(content)

    return fault


def read_only(bag: Path) -> None:
    for one in (*files(bag), *([bag] if bag.is_dir() else [])):
        one.chmod(0o555 if one.is_dir() else 0o444)


def renamed(bag: Path) -> None:
    if bag.is_dir():
        files(bag)[0].rename(bag / f"other{files(bag)[0].suffix}")


FAULTS: dict[str, Callable[[Path], None]] = {
    "none": lambda bag: None,
    "cut in its head": cut(lambda size: 20),
    "cut in the middle": cut(lambda size: size // 2),
    "cut at three quarters": cut(lambda size: 3 * size // 4),
    "without end magic": cut(lambda size: size - 8),
    "one byte short": cut(lambda size: size - 1),
    "empty file": cut(lambda size: 0),
    "metadata missing": lambda bag: (bag / "metadata.yaml").unlink() if bag.is_dir() else None,
    "metadata count more": edit("message_count: 50", "message_count: 51"),
    "metadata count less": edit("message_count: 50", "message_count: 49"),
    "metadata of another QoS": edit("reliability: (reliable|1)", "reliability: best_effort"),
    "metadata of another type": edit("type: std_msgs/msg/String", "type: std_msgs/msg/Header"),
    "metadata without hashes": edit(
        r"type_description_hash:\s*[^\s,}]+", "type_description_hash: ''"
    ),
    "metadata of other times": edit("nanoseconds(.*): [0-9]+", rf"nanoseconds\1: {2**63 - 1}"),
    "file missing": lambda bag: files(bag)[0].unlink() if bag.is_dir() else None,
    "file renamed": renamed,
    "log beside": beside("-wal", b"something"),
    "another file beside": beside(".txt", b"something"),
    "read only": read_only,
    "messages of no topic": execute(
        "INSERT INTO messages(id, topic_id, timestamp, data) VALUES (999, 99, 1000, x'00')"
    ),
    "checksum": flip,
}
# With these everything is read.
HARMLESS = (
    "none",
    "metadata of another QoS",
    "metadata without hashes",
    "metadata of other times",
    "another file beside",
    "read only",
    "messages of no topic",
)


def read(bag: Path) -> Sortable:
    with BagReader(bag) as reader:
        return sorted(reader.serialized())


# With these a repair loses nothing.
INTACT = ("metadata missing", "metadata count more", "metadata of another type")
COMPRESSED = [name for name in WRITERS if name.endswith(("messages", "file", "chunks"))]
CASES = list(itertools.product(WRITERS, ["none"]))
CASES += itertools.product([*COMPRESSED, "own mcap", "own sqlite3"], INTACT[:2])
for name in FAULTS:
    CASES += sampled(itertools.product(WRITERS, [name]), name, 12)


@pytest.mark.parametrize(("writer", "fault"), dict.fromkeys(CASES))
def test_a_bag_is_read_whole_or_refused(tmp_path: Path, writer: str, fault: str) -> None:
    bag = WRITERS[writer](tmp_path / "bag")
    FAULTS[fault](bag)
    whole = sorted(TRUTH)
    try:
        said = {topic.name: topic.count for topic in inspect_bag(bag).topics if topic.count}
        found = read(bag)
    except BagError as error:
        refusal = str(error)
    else:
        refusal = ""
    if refusal:
        assert fault not in HARMLESS
        assert "bag repair" in refusal
        assert not check(bag).is_sound
        if files(bag):
            done = repair(bag, tmp_path / "repaired")
            kept = read(tmp_path / "repaired")
            assert len(kept) == done.messages
            assert kept == whole if fault in INTACT else not set(kept) - set(whole)
        return
    assert found == whole
    counted = Counter(name for name, _, _ in found)
    assert said == counted or not check(bag).is_sound
    assert (said == counted) == (fault != "metadata count less" or bag.is_file())


@pytest.mark.parametrize("fault", [f for f in FAULTS if f.startswith("cut") or "file" in f])
def test_a_fault_is_one(tmp_path: Path, fault: str) -> None:
    """Of a faulty bag something is refused, or the fault is none."""
    bag = own(tmp_path / "bag", "mcap", split=True)
    FAULTS[fault](bag)
    assert check(bag).is_sound == (fault == "another file beside")


@pytest.mark.parametrize("index", mcap.IndexType.__members__)
@pytest.mark.parametrize("chunks", ["loose", *mcap.CompressionType.__members__])
@pytest.mark.parametrize("statistics", [True, False])
@pytest.mark.parametrize("channels", [True, False])
@pytest.mark.parametrize("schemas", [True, False])
def test_an_index_may_lack_any_part(
    tmp_path: Path, index: str, chunks: str, statistics: bool, channels: bool, schemas: bool
) -> None:
    packed = mcap.CompressionType["NONE" if chunks == "loose" else chunks]
    bag = alone(
        tmp_path / "bag",
        index_types=mcap.IndexType[index],
        use_chunking=chunks != "loose",
        compression=packed,
        use_statistics=statistics,
        repeat_channels=channels,
        repeat_schemas=schemas,
    )
    info = inspect_bag(bag)
    assert {topic.name: topic.count for topic in info.topics} == {"/f": 50, "/g": 50}
    assert info.duration_s == pytest.approx(49e-6)
    assert read(bag) == sorted(TRUTH)
    assert check(bag).is_sound
    with BagReader(bag) as reader:
        times = [time_ns for _, time_ns, _ in reader.serialized()]
        assert times == sorted(times)
        assert sum(1 for _ in reader.serialized("/g")) == 50
