# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Reading bags, whole and damaged."""

from __future__ import annotations

import shutil
import sqlite3
from contextlib import closing
from pathlib import Path

import pytest

from bag.record import Bytes, record
from hapticmech_ros.bag import BagReader, read_topic
from hapticmech_ros.bag.repair import repair
from hapticmech_ros.errors import BagError

STORAGES = {"mcap": "bag_0.mcap", "sqlite3": "bag_0.db3"}


@pytest.fixture(params=STORAGES)
def bag(request: pytest.FixtureRequest, tmp_path: Path, wrench_bytes: Bytes) -> Path:
    sent = [(("/f", "/g")[i % 2], 1000 * i, wrench_bytes(i, float(i))) for i in range(400)]
    return record(tmp_path / "bag", sent, request.param)


def test_reads_topics_in_one_pass_in_order_of_time(bag: Path) -> None:
    with BagReader(bag) as reader:
        items = list(reader.messages("/f", "/g"))
        alone = [item.message.wrench.force.x for item in reader.messages("/g")]
    assert [item.time_ns for item in items] == [1000 * i for i in range(400)]
    assert [item.topic for item in items[:3]] == ["/f", "/g", "/f"]
    assert alone == [float(i) for i in range(1, 400, 2)]


def test_reads_one_topic_without_ceremony(bag: Path) -> None:
    found = [(time, message.wrench.force.y) for time, message in read_topic(bag, "/f")]
    assert found == [(1000 * i, 2.0 * i) for i in range(0, 400, 2)]


def test_closes_once(bag: Path) -> None:
    reader = BagReader(bag)
    reader.close()
    reader.close()


def test_no_such_topic(bag: Path) -> None:
    with BagReader(bag) as reader, pytest.raises(BagError, match="no topic /h, /i"):
        list(reader.messages("/f", "/h", "/i"))


def test_no_such_bag(tmp_path: Path) -> None:
    with pytest.raises(BagError, match=r"no bag at .*nowhere"):
        BagReader(tmp_path / "nowhere")


@pytest.mark.parametrize("content", ["", "{", "rosbag2_bagfile_information: 3\n", "- 1\n"])
def test_metadata_of_nonsense(bag: Path, content: str) -> None:
    (bag / "metadata.yaml").write_text(content)
    with pytest.raises(BagError, match="damaged"):
        BagReader(bag)


@pytest.mark.parametrize("storage", STORAGES)
def test_message_of_nonsense(storage: str, tmp_path: Path) -> None:
    bag = record(tmp_path / "bag", [("/f", 1, b"\x00\x01\x00\x00abc")], storage)
    with (
        BagReader(bag) as reader,
        pytest.raises(BagError, match=r"\(topic /f\) is damaged"),
    ):
        list(reader.messages("/f"))


def test_fewer_messages_than_stated_are_said_at_the_end(bag: Path) -> None:
    file = bag / "metadata.yaml"
    text = file.read_text(encoding="utf-8")
    file.write_text(text.replace("message_count: 200", "message_count: 201"), encoding="utf-8")
    with BagReader(bag) as reader:
        # Of a part nobody knows how many there are.
        assert sum(1 for _ in reader.serialized(stop_ns=1000)) == 1
        with pytest.raises(BagError, match="200 messages can be read, of 201 stated"):
            list(reader.messages())


@pytest.mark.parametrize("frozen", [False, True])
def test_what_sqlite_has_left_beside_a_file_is_not_left_out(
    tmp_path: Path, wrench_bytes: Bytes, frozen: bool
) -> None:
    """A writer in WAL mode that was killed: half of its messages stand in the log alone."""
    sent = [("/f", i, wrench_bytes(i, 1.0)) for i in range(20)]
    path = record(tmp_path / "bag", sent, "sqlite3")
    file = path / "bag_0.db3"
    with closing(sqlite3.connect(file, isolation_level=None)) as database:
        database.execute("PRAGMA journal_mode=WAL")
        database.execute("PRAGMA wal_autocheckpoint=0")
        rows = database.execute("SELECT topic_id, timestamp, data FROM messages").fetchall()
        later = [(topic, time + 100, data) for topic, time, data in rows]
        database.executemany(
            "INSERT INTO messages (topic_id, timestamp, data) VALUES (?, ?, ?)", later
        )
        left = tmp_path / "left"
        shutil.copytree(path, left)
    if frozen:
        for one in (*left.iterdir(), left):
            one.chmod(0o555 if one.is_dir() else 0o444)
    with pytest.raises(BagError, match=r"bag_0.db3-wal beside it.*bag repair"):
        BagReader(left)
    with pytest.raises(BagError, match=r"bag_0.db3-wal beside it"):
        BagReader(left / "bag_0.db3")
    assert repair(left, tmp_path / "whole").messages == 40
    with BagReader(tmp_path / "whole") as reader:
        assert sum(1 for _ in reader.serialized()) == 40
    left.chmod(0o755)


def test_a_half_written_change_is_not_read(bag: Path) -> None:
    if not (bag / "bag_0.db3").exists():
        return
    (bag / "bag_0.db3-journal").write_bytes(b"something")
    with pytest.raises(BagError, match=r"bag_0.db3-journal beside it"):
        BagReader(bag)
    (bag / "bag_0.db3-journal").write_bytes(b"")
    BagReader(bag).close()
