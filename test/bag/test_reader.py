# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Reading bags, whole and damaged."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from hapticmech_ros.bag import BagReader, BagWriter, read_topic
from hapticmech_ros.errors import BagError

Bytes = Callable[[int, float], bytes]
WRENCH = "geometry_msgs/msg/WrenchStamped"
STORAGES = {"mcap": "bag_0.mcap", "sqlite3": "bag_0.db3"}


@pytest.fixture(params=STORAGES)
def bag(request: pytest.FixtureRequest, tmp_path: Path, wrench_bytes: Bytes) -> Path:
    path = tmp_path / "bag"
    with BagWriter(path, request.param) as writer:
        writer.add_topic("/f", WRENCH)
        writer.add_topic("/g", WRENCH)
        for i in range(400):
            writer.write("/g" if i % 2 else "/f", 1000 * i, wrench_bytes(i, float(i)))
    return path


def storage_file(bag: Path) -> Path:
    (found,) = [bag / name for name in STORAGES.values() if (bag / name).exists()]
    return found


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


def test_reads_a_storage_file_alone(bag: Path) -> None:
    with BagReader(storage_file(bag)) as reader:
        assert {name: topic.count for name, topic in reader.topics.items()} == {
            "/f": 200,
            "/g": 200,
        }


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


def test_recording_that_was_killed(bag: Path) -> None:
    (bag / "metadata.yaml").unlink()
    with pytest.raises(BagError, match=r"has no metadata\.yaml.*cut short"):
        BagReader(bag)


@pytest.mark.parametrize("share", [0.0, 0.001, 0.5, 0.99])
def test_storage_file_cut_short(bag: Path, share: float) -> None:
    file = storage_file(bag)
    data = file.read_bytes()
    file.write_bytes(data[: int(share * len(data))])
    with pytest.raises(BagError, match="cut short"), BagReader(bag) as reader:
        list(reader.messages())


@pytest.mark.parametrize("content", ["", "{", "rosbag2_bagfile_information: 3\n", "- 1\n"])
def test_metadata_of_nonsense(bag: Path, content: str) -> None:
    (bag / "metadata.yaml").write_text(content)
    with pytest.raises(BagError, match="damaged"):
        BagReader(bag)


@pytest.mark.parametrize("storage", STORAGES)
def test_message_of_nonsense(storage: str, tmp_path: Path) -> None:
    with BagWriter(tmp_path / "bag", storage) as writer:
        writer.add_topic("/f", WRENCH)
        writer.write("/f", 1, b"\x00\x01\x00\x00abc")
    with (
        BagReader(tmp_path / "bag") as reader,
        pytest.raises(BagError, match=r"\(topic /f\) is damaged"),
    ):
        list(reader.messages("/f"))
