# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Metadata as rosbag2 of ROS 2 Jazzy writes it, field by field."""

from __future__ import annotations

import sqlite3
from collections.abc import Callable
from pathlib import Path

import pytest
from mcap.reader import make_reader
from rosbags.interfaces import QosDurability, QosReliability
from rosbags.rosbag2 import Reader
from ruamel.yaml import YAML

from bag.record import metadata
from hapticmech_ros import load_scene
from hapticmech_ros.bag import BagReader, BagWriter
from hapticmech_ros.bag.check import check, inspect_bag
from hapticmech_ros.bag.metadata import as_yaml, offered_qos, read_metadata
from hapticmech_ros.errors import BagError
from hapticmech_ros.mechanism import Mechanism
from hapticmech_ros.nodes.bags.bag_player import cut_of
from hapticmech_ros.offline import states_from_bag

STRING = "std_msgs/msg/String"
# As `ros2 topic info -v` of ROS 2 shows it.
STRING_HASH = "RIHS01_df668c740482bbd48fb39d76a70dfd4bd59db1288021743503259e948f6b1a18"
HELLO = b"\x00\x01\x00\x00\x03\x00\x00\x00hi\x00"
STORAGES = {"mcap": "bag_0.mcap", "sqlite3": "bag_0.db3"}


@pytest.fixture(params=STORAGES)
def bag(request: pytest.FixtureRequest, tmp_path: Path) -> Path:
    with BagWriter(tmp_path / "bag", request.param) as writer:
        best = offered_qos("stream")._replace(reliability=QosReliability.BEST_EFFORT)
        writer.add_topic("/s", STRING, offered=[best, offered_qos("latched")])
        writer.write("/s", 1_000_000_007, HELLO)
        writer.write("/s", 3_000_000_009, HELLO)
    return tmp_path / "bag"


def test_every_field(bag: Path) -> None:
    (name,) = [name for name in STORAGES.values() if (bag / name).exists()]
    for_ever = {"sec": 9223372036, "nsec": 854775807}
    same = {
        "history": "keep_last",
        "deadline": for_ever,
        "lifespan": for_ever,
        "liveliness": "automatic",
        "liveliness_lease_duration": for_ever,
        "avoid_ros_namespace_conventions": False,
    }
    profiles = [
        {**same, "depth": 10, "reliability": "best_effort", "durability": "volatile"},
        {**same, "depth": 1, "reliability": "reliable", "durability": "transient_local"},
    ]
    span = {
        "duration": {"nanoseconds": 2_000_000_002},
        "starting_time": {"nanoseconds_since_epoch": 1_000_000_007},
        "message_count": 2,
    }
    topic = {
        "name": "/s",
        "type": STRING,
        "serialization_format": "cdr",
        "offered_qos_profiles": profiles,
        "type_description_hash": STRING_HASH,
    }
    assert metadata(bag) == {
        "version": 9,
        "storage_identifier": "mcap" if name.endswith("mcap") else "sqlite3",
        **span,
        "topics_with_message_count": [{"topic_metadata": topic, "message_count": 2}],
        "compression_format": "",
        "compression_mode": "",
        "relative_file_paths": [name],
        "files": [{"path": name, **span}],
        "custom_data": None,
        "ros_distro": "jazzy",
    }


def test_the_storage_says_the_same_as_the_metadata(bag: Path) -> None:
    (file,) = [bag / name for name in STORAGES.values() if (bag / name).exists()]
    if file.suffix == ".mcap":
        with file.open("rb") as stream:
            reader = make_reader(stream)
            summary = reader.get_summary()
            (channel,) = summary.channels.values()
            (note,) = list(reader.iter_metadata())
        notes, text = channel.metadata, note.metadata["serialized_metadata"]
        qos, type_hash = notes["offered_qos_profiles"], notes["topic_type_hash"]
    else:
        database = sqlite3.connect(file)
        query = "SELECT offered_qos_profiles, type_description_hash FROM topics"
        ((qos, type_hash),) = database.execute(query).fetchall()
        ((version, text),) = database.execute("SELECT metadata_version, metadata FROM metadata")
        database.close()
        assert version == 9
    outside = metadata(bag)
    yaml = YAML(typ="safe")
    assert yaml.load(text) == outside
    topic = outside["topics_with_message_count"][0]["topic_metadata"]
    assert yaml.load(qos) == topic["offered_qos_profiles"]
    assert type_hash == STRING_HASH


def test_the_reader_knows_qos_and_hash(bag: Path) -> None:
    with BagReader(bag) as reader, Reader(bag) as other:
        topic = reader.topics["/s"]
        assert len(list(other.messages())) == 2
    assert [offer.durability for offer in topic.offered] == [
        QosDurability.VOLATILE,
        QosDurability.TRANSIENT_LOCAL,
    ]
    assert topic.type_hash == STRING_HASH


@pytest.mark.parametrize("storage", STORAGES)
def test_metadata_is_there_from_the_beginning_and_says_so(storage: str, tmp_path: Path) -> None:
    writer = BagWriter(tmp_path / "bag", storage)
    writer.add_topic("/s", STRING)
    writer.write("/s", 1, HELLO)
    writer.flush()
    found = metadata(tmp_path / "bag")
    assert [t["topic_metadata"]["name"] for t in found["topics_with_message_count"]] == ["/s"]
    with pytest.raises(BagError, match=r"unfinished: .*`hapticmech bag repair .*bag`"):
        BagReader(tmp_path / "bag")
    writer.close()
    with BagReader(tmp_path / "bag") as reader:
        assert reader.topics["/s"].count == 1
    assert not list((tmp_path / "bag").glob("*.tmp"))


NEVER = 2**63 - 1


@pytest.mark.parametrize("storage", ["mcap", "sqlite3"])
@pytest.mark.parametrize("start", [NEVER, -1, -NEVER - 1])
@pytest.mark.parametrize("lasting", [NEVER, NEVER + 1, 0, -1])
def test_times_are_those_of_the_files_whatever_metadata_say(
    tmp_path: Path,
    wrench_bytes: Callable[[int, float], bytes],
    storage: str,
    start: int,
    lasting: int,
) -> None:
    """Of bags without messages they say 2^63 - 1 ns where there is no time."""
    for number in (0, 3):
        path = tmp_path / f"bag{number}"
        with BagWriter(path, storage) as writer:
            writer.add_topic("/f", "geometry_msgs/msg/WrenchStamped")
            for i in range(number):
                writer.write("/f", 1000 + 10 * i, wrench_bytes(i, 1.0))
        file = path / "metadata.yaml"
        written = YAML(typ="safe").load(file.read_text(encoding="utf-8"))
        (said,) = written.values()
        for part in (said, *said["files"]):
            part["starting_time"] = {"nanoseconds_since_epoch": start}
            part["duration"] = {"nanoseconds": lasting}
        file.write_text(as_yaml(written), encoding="utf-8")
        info = inspect_bag(path)
        assert (info.messages, info.start_ns) == ((3, 1000) if number else (0, 0))
        assert info.duration_s == pytest.approx(20e-9 if number else 0.0)
        assert info.files[0].duration_s == (0.0 if lasting == 0 else None)
        assert check(path).is_sound == (number > 0)
        with BagReader(path) as bag:
            assert len(list(bag.messages())) == number
            if number:
                cut = cut_of(bag, ())
                assert (cut.start_ns, cut.stop_ns) == (1000, 1021)


@pytest.mark.parametrize("storage", ["mcap", "sqlite3"])
def test_a_bag_without_messages_is_written_as_rosbag2_does(tmp_path: Path, storage: str) -> None:
    BagWriter(tmp_path / "bag", storage).close()
    said = read_metadata(tmp_path / "bag")
    for part in (said, *said["files"]):
        assert part["starting_time"] == {"nanoseconds_since_epoch": NEVER}
        assert part["duration"] == {"nanoseconds": 0}
    with pytest.raises(BagError, match="no messages on /mechanism/measured_js"):
        states_from_bag(tmp_path / "bag", Mechanism(load_scene("two_link")))
