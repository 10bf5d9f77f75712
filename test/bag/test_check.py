# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Sound bags, and bags with faults put in."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pytest
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore
from ruamel.yaml import YAML

from bag.record import MS, WRENCH, Bytes, record
from hapticmech_ros.bag import BagWriter
from hapticmech_ros.bag.check import absent, check, inspect_bag
from hapticmech_ros.errors import BagError
from hapticmech_ros.wire.topics import TOPICS

START = 10**18


def write(path: Path, make: Bytes, stamps: Sequence[int], storage: str = "mcap") -> Path:
    sent = [("/f", START + i * MS, make(stamp, 1.0)) for i, stamp in enumerate(stamps)]
    return record(path, sent, storage)


SOUND = {"count": 100, "backwards": 0, "repeated": 0, "lost": 0, "gaps": 0, "stamped": True}
# Stamps in ms, and what is said of their topic.
STAMPS: dict[str, tuple[list[int], dict[str, Any]]] = {
    "even": ([*range(100)], SOUND | {"notes": (), "rate_hz": pytest.approx(1000.0)}),
    "gaps, and what they swallowed": (
        [i for i in range(200) if i not in (50, 51, 52, 120)],
        {"gaps": 2, "lost": 4, "largest_gap_s": pytest.approx(0.004)},
    ),
    "no losses without a period": ([i * i for i in range(50)], {"lost": None}),
    "back, and at a stand": ([0, 1, 2, 2, 3, 5, 4, 6, 7], {"backwards": 1, "repeated": 1}),
}


@pytest.mark.parametrize(("stamps", "expected"), STAMPS.values(), ids=STAMPS)
@pytest.mark.parametrize("storage", ["mcap", "sqlite3"])
def test_stamps_of_a_sound_bag(
    storage: str,
    stamps: list[int],
    expected: dict[str, Any],
    tmp_path: Path,
    wrench_bytes: Bytes,
) -> None:
    sent = [START + ms * MS for ms in stamps]
    report = check(write(tmp_path / "bag", wrench_bytes, sent, storage))
    assert report.is_sound
    (topic,) = report.topics
    assert {name: getattr(topic, name) for name in expected} == expected
    json.dumps(report.as_dict())


def test_messages_that_cannot_be_decoded(tmp_path: Path, wrench_bytes: Bytes) -> None:
    whole = wrench_bytes(1, 1.0)
    report = check(record(tmp_path / "bag", [("/f", 1, whole), ("/f", 2, whole[:30])]))
    assert report.topics[0].undecodable == 1
    assert report.damage == ("topic /f: 1 messages cannot be decoded",)


def test_fewer_messages_than_stated(tmp_path: Path, wrench_bytes: Bytes) -> None:
    path = write(tmp_path / "bag", wrench_bytes, [START + i * MS for i in range(10)])
    yaml, file = YAML(typ="safe"), path / "metadata.yaml"
    found = yaml.load(file.read_text())
    found["rosbag2_bagfile_information"]["topics_with_message_count"][0]["message_count"] = 11
    with file.open("w") as stream:
        yaml.dump(found, stream)
    assert check(path).damage == ("topic /f: 10 messages can be read, of 11 stated",)


def test_unfinished_and_cut_bags_are_damaged(tmp_path: Path, wrench_bytes: Bytes) -> None:
    writer = BagWriter(tmp_path / "live")
    writer.add_topic("/f", WRENCH, "latched")
    for i in range(20):
        writer.write("/f", START + i * 100 * MS, wrench_bytes(1, 1.0))
    writer.split()
    assert "unfinished" in check(tmp_path / "live").damage[0]
    info = inspect_bag(tmp_path / "live")
    assert not info.finished
    assert (info.messages, len(info.files)) == (20, 2)
    assert info.topics[0].durability == ("transient_local",)
    writer.close()
    assert inspect_bag(tmp_path / "live").finished
    path = write(tmp_path / "bag", wrench_bytes, [START + i * MS for i in range(100)])
    data = (path / "bag_0.mcap").read_bytes()
    (path / "bag_0.mcap").write_bytes(data[: len(data) // 2])
    assert not check(path).is_sound
    with pytest.raises(BagError, match="no bag at"):
        check(tmp_path / "nowhere")


def test_missing_qos_and_foreign_types_are_noted(tmp_path: Path) -> None:
    with Writer(tmp_path / "bag", version=9, storage_plugin=StoragePlugin.SQLITE3) as writer:
        store = get_typestore(Stores.ROS2_JAZZY)
        writer.write(writer.add_connection("/f", "std_msgs/msg/UInt8", typestore=store), 1, b"")
    notes = check(tmp_path / "bag").topics[0].notes
    assert notes == ("no QoS of its publishers",)


def test_names_the_topics_of_the_graph_that_are_absent() -> None:
    names = ["/left/" + topic.of("handle") for topic in TOPICS if not topic.name.startswith("/")]
    assert absent([*names, "/diagnostics"]) == ()
    assert absent(names) == ("/diagnostics",)
    without = [name for name in names if not name.endswith("operational_model")]
    assert absent([*without, "/diagnostics"]) == ("analysis/{point}/operational_model",)
    assert absent(["/chatter", "/diagnostics"]) == ()


def test_information_of_a_bag(tmp_path: Path, wrench_bytes: Bytes) -> None:
    path = write(tmp_path / "bag", wrench_bytes, range(101))
    info = inspect_bag(path)
    assert (info.storage, info.messages, info.start_ns) == ("mcap", 101, START)
    assert info.duration_s == pytest.approx(0.1)
    assert info.bytes == (path / "bag_0.mcap").stat().st_size
    (topic,) = info.topics
    assert topic.rate_hz == pytest.approx(1000.0)
    assert (topic.reliability, topic.durability) == (("reliable",), ("volatile",))
    assert topic.type_hash.startswith("RIHS01_")
    assert json.loads(json.dumps(info.as_dict()))["files"][0]["messages"] == 101
    alone = inspect_bag(path / "bag_0.mcap")
    assert (alone.messages, alone.version) == (101, None)
