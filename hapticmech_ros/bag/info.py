# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What is in a bag, without reading its messages."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from rosbags.interfaces import Qos
from rosbags.rosbag2.metadata import parse_qos

from hapticmech_ros.bag.metadata import is_unfinished, losses_of, read_metadata
from hapticmech_ros.bag.reader import BagReader, BagTopic
from hapticmech_ros.bag.storage import SUFFIXES
from hapticmech_ros.errors import BagError
from hapticmech_ros.files import exists
from hapticmech_ros.times import NANOSECONDS


@dataclass(frozen=True, slots=True)
class TopicInfo:
    """One topic: rate in Hz over the bag's duration; QoS of its publishers, each value once."""

    name: str
    type: str
    count: int
    rate_hz: float
    publishers: int
    reliability: tuple[str, ...]
    durability: tuple[str, ...]
    type_hash: str


@dataclass(frozen=True, slots=True)
class FileInfo:
    """One storage file: size on disk, and what the metadata tell of its messages.

    None where they tell nothing, or a duration that is none: negative, or longer than the bag's.
    """

    name: str
    bytes: int
    messages: int | None
    duration_s: float | None


@dataclass(frozen=True, slots=True)
class BagInfo:
    """What is in a bag.

    Attributes:
        path: of the bag.
        storage: ``mcap`` or ``sqlite3``.
        finished: False while it is recorded, or if the recording was cut short; counts and times
            are then those of the last time that metadata were written.
        version: of the metadata; None for a single file.
        distribution: ROS distribution that wrote it; empty if unknown.
        compression: such as ``zstd (message)``; empty for none.
        start_ns: time of the first message, ns; 0 for an empty bag.
        duration_s: from the first to the last message, s.
        messages: in all.
        files: in order.
        topics: by name.
        lost: messages that the recording lost, of each topic that lost any (None: not known); None
            where the recorder has not counted.
    """

    path: Path
    storage: str
    finished: bool
    version: int | None
    distribution: str
    compression: str
    start_ns: int
    duration_s: float
    messages: int
    files: tuple[FileInfo, ...]
    topics: tuple[TopicInfo, ...]
    lost: Mapping[str, int | None] | None = None

    @property
    def bytes(self) -> int:
        """Size of all files on disk."""
        return sum(file.bytes for file in self.files)

    def as_dict(self) -> dict[str, Any]:
        """Return everything for JSON."""
        return {**asdict(self), "path": str(self.path), "bytes": self.bytes}


def inspect_bag(path: str | os.PathLike[str]) -> BagInfo:
    """Return what is in the bag at ``path``: a folder, or a single file.

    Raises:
        BagError: no such bag, damaged, or without metadata.
    """
    folder = Path(path)
    if not exists(folder):
        raise BagError(f"no bag at {folder}")
    information = read_metadata(folder) if folder.is_dir() else {}
    if is_unfinished(information):
        try:
            return _from_metadata(folder, information)
        except (KeyError, TypeError, ValueError, AttributeError) as error:
            raise BagError(f"bag {folder}: metadata that cannot be read: {error}") from error
    with BagReader(folder) as bag:
        first, last = bag.span_ns
        duration = (last - first) / NANOSECONDS
        return BagInfo(
            folder,
            str(information.get("storage_identifier") or SUFFIXES[folder.suffix]),
            True,
            information.get("version"),
            str(information.get("ros_distro") or ""),
            _compression(information),
            first,
            duration,
            sum(topic.count for topic in bag.topics.values()),
            _files(folder, information, last - first),
            tuple(_topic(name, topic, duration) for name, topic in bag.topics.items()),
            losses_of(information),
        )


def _from_metadata(folder: Path, information: dict[str, Any]) -> BagInfo:
    count = int(information["message_count"])
    span = max(0, information["duration"]["nanoseconds"]) if count else 0
    duration = span / NANOSECONDS
    topics = []
    for entry in information["topics_with_message_count"]:
        data = entry["topic_metadata"]
        offered: tuple[Qos, ...] = tuple(parse_qos(data["offered_qos_profiles"]))
        topic = BagTopic(
            data["type"], entry["message_count"], offered, data["type_description_hash"]
        )
        topics.append(_topic(data["name"], topic, duration))
    return BagInfo(
        folder,
        information["storage_identifier"],
        False,
        information["version"],
        information["ros_distro"],
        _compression(information),
        information["starting_time"]["nanoseconds_since_epoch"] if count else 0,
        duration,
        count,
        _files(folder, information, span),
        tuple(sorted(topics, key=lambda topic: topic.name)),
    )


def _topic(name: str, topic: BagTopic, duration: float) -> TopicInfo:
    # n messages at an even rate span n - 1 periods.
    rate = (topic.count - 1) / duration if duration > 0.0 and topic.count > 1 else 0.0
    return TopicInfo(
        name,
        topic.type,
        topic.count,
        rate,
        len(topic.offered),
        tuple(sorted({offer.reliability.name.lower() for offer in topic.offered})),
        tuple(sorted({offer.durability.name.lower() for offer in topic.offered})),
        topic.type_hash,
    )


def _files(folder: Path, information: dict[str, Any], span_ns: int) -> tuple[FileInfo, ...]:
    if not information:
        return (FileInfo(folder.name, folder.stat().st_size, None, None),)
    told = {entry.get("path"): entry for entry in information.get("files") or []}
    found = []
    for name in information.get("relative_file_paths") or []:
        file = folder / Path(name).name
        entry = told.get(name, {})
        lasted = entry["duration"]["nanoseconds"] if "duration" in entry else -1
        found.append(
            FileInfo(
                file.name,
                file.stat().st_size if file.exists() else 0,
                entry.get("message_count"),
                lasted / NANOSECONDS if 0 <= lasted <= span_ns else None,
            )
        )
    return tuple(found)


def _compression(information: dict[str, Any]) -> str:
    mode = str(information.get("compression_mode") or "").lower()
    return f"{information.get('compression_format')} ({mode})" if mode not in ("", "none") else ""
