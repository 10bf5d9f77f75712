# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Bags of messages that tests have made."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any

import mcap.writer as mcap
from rosbags.typesys import Stores, get_typestore
from ruamel.yaml import YAML

from hapticmech_ros.bag import BagReader, BagWriter

Bytes = Callable[[int, float], bytes]
WRENCH = "geometry_msgs/msg/WrenchStamped"
MS = 1_000_000
STORE = get_typestore(Stores.ROS2_JAZZY)
# Of the files of each storage.
SUFFIXES = {"mcap": ".mcap", "sqlite3": ".db3"}


def metadata(bag: Path) -> dict[str, Any]:
    """Return a bag's metadata as another reader of YAML has them."""
    text = (bag / "metadata.yaml").read_text(encoding="utf-8")
    found: dict[str, Any] = YAML(typ="safe").load(text)["rosbag2_bagfile_information"]
    return found


def record(
    path: Path,
    messages: Iterable[tuple[str, int, bytes]],
    storage: str = "mcap",
    msgtype: str = WRENCH,
    qos: str = "stream",
    split_ns: int | None = None,
) -> Path:
    """Write topics, times of reception (ns) and serialized messages; return the bag's path."""
    with BagWriter(path, storage, split_ns=split_ns) as bag:
        for name, time_ns, data in messages:
            if name not in bag.counts:
                bag.add_topic(name, msgtype, qos)
            bag.write(name, time_ns, data)
    return path


def alone(
    path: Path, messages: Sequence[tuple[str, int, bytes]], msgtype: str, **kinds: Any
) -> Path:
    """Write a file by mcap's own writer, in small chunks."""
    with path.open("wb") as stream:
        writer = mcap.Writer(stream, chunk_size=1000, **kinds)
        writer.start(profile="ros2", library="not rosbag2")
        text, _ = STORE.generate_msgdef(msgtype, ros_version=2)
        schema = writer.register_schema(msgtype, "ros2msg", text.encode())
        names = dict.fromkeys(name for name, _, _ in messages)
        channels = {name: writer.register_channel(name, "cdr", schema) for name in names}
        for name, time_ns, data in messages:
            writer.add_message(channels[name], time_ns, data, time_ns)
        writer.finish()
    return path


def times(bag: Path) -> list[int]:
    """Return when each message was received, in the order in which they are read, ns."""
    with BagReader(bag) as reader:
        return [time for _, time, _ in reader.serialized()]
