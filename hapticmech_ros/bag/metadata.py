# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The ``metadata.yaml`` of a rosbag2 folder, version 9, as ROS 2 Jazzy writes it.

Metadata of an unfinished recording is marked under ``custom_data``, which rosbag2 ignores.

It has the QoS profiles of each topic's publishers. A player gives them to its own publishers, so
latched topics stay latched on replay.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from io import StringIO
from pathlib import Path, PurePosixPath
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, ValidationError
from rosbags.interfaces import (
    Qos,
    QosDurability,
    QosHistory,
    QosLiveliness,
    QosReliability,
    QosTime,
)
from rosbags.rosbag2.metadata import dump_qos_v9, parse_qos
from ruamel.yaml import YAML

from hapticmech_ros.bag.storage import LATEST_NS, NO_DEFINITION, DamageError, StoredTopic
from hapticmech_ros.errors import BagError, FileError, listed
from hapticmech_ros.files import read_text
from hapticmech_ros.files.yaml_text import read_yaml

# "For ever" as rmw and rosbag2 write it: the largest count of nanoseconds in 64 bits.
INFINITE = QosTime(9223372036, 854775807)


def _offered(depth: int, durability: QosDurability) -> Qos:
    return Qos(
        history=QosHistory.KEEP_LAST,
        depth=depth,
        reliability=QosReliability.RELIABLE,
        durability=durability,
        deadline=INFINITE,
        lifespan=INFINITE,
        liveliness=QosLiveliness.AUTOMATIC,
        liveliness_lease_duration=INFINITE,
        avoid_ros_namespace_conventions=False,
    )


_STREAM = _offered(10, QosDurability.VOLATILE)

# Names as in wire/topics.py. Every publisher of the graph is reliable, whatever its readers ask.
OFFERED: dict[str, Qos] = {
    "control": _STREAM,
    "stream": _STREAM,
    "command": _STREAM,
    "latched": _offered(1, QosDurability.TRANSIENT_LOCAL),
}


def offered_qos(name: str) -> Qos:
    """Return the profile of a topic's ``qos`` name.

    Raises:
        BagError: unknown name.
    """
    if name not in OFFERED:
        raise BagError(f"quality of service {name!r}: must be one of {listed(sorted(OFFERED))}")
    return OFFERED[name]


def read_offers(said: object) -> tuple[Qos, ...]:
    """Return the profiles that a bag has for a topic.

    Args:
        said: a list of mappings, or text: YAML of such a list.

    Raises:
        DamageError: not profiles as rosbag2 writes them.
    """
    try:
        items = read_yaml(said, "offered_qos_profiles") if isinstance(said, str) else said
        if items is None:
            return ()
        if not isinstance(items, list):
            raise TypeError("not a list")
        found = tuple(parse_qos(items))
    except (FileError, TypeError, KeyError, AttributeError, ValueError) as error:
        raise DamageError(f"offered_qos_profiles cannot be read ({error})") from None
    for offer in found:
        times = (offer.deadline, offer.lifespan, offer.liveliness_lease_duration)
        numbers = [offer.depth, *(part for time in times for part in (time.sec, time.nsec))]
        if not all(type(number) is int and 0 <= number <= LATEST_NS for number in numbers):
            raise DamageError(f"offered_qos_profiles have a number out of range ({offer})")
    return found


VERSION: Literal[9] = 9
DISTRIBUTION = "jazzy"
FILE_NAME = "metadata.yaml"
ROOT = "rosbag2_bagfile_information"
# Key and value in custom_data while the writer is still at it.
UNFINISHED = ("recording", "unfinished")
# Key in custom_data of how many messages a recording has lost; of one topic with its name behind.
LOST, UNKNOWN = "lost", "unknown"
# Bytes of the file; one of a thousand files and a hundred topics has 300 kB.
SIZE_LIMIT = 8_000_000


def in_folder(name: str) -> str:
    """Return the name of a storage file, which has to be one in the bag's folder.

    Before version 4 the folder's name stood before it.

    Raises:
        ValueError: it is elsewhere.
    """
    path = PurePosixPath(name)
    if path.is_absolute() or ".." in path.parts or not path.name or "\0" in name:
        raise ValueError("must be a file in the bag's folder")
    return name


_Count = Annotated[int, Field(strict=True, ge=0, le=LATEST_NS)]
_Number = Annotated[int, Field(strict=True, ge=-LATEST_NS - 1, le=LATEST_NS + 1)]
_Text = Annotated[str, Field(strict=True)]
_FileName = Annotated[_Text, AfterValidator(in_folder)]


class _Part(BaseModel):
    """Part of the metadata; newer versions may have more keys."""

    model_config = ConfigDict(extra="ignore")


class _Start(_Part):
    nanoseconds_since_epoch: _Number


class _Duration(_Part):
    nanoseconds: _Number


class _File(_Part):
    path: _FileName
    starting_time: _Start
    duration: _Duration
    message_count: _Count


class _TopicMetadata(_Part):
    name: _Text
    type: _Text
    serialization_format: _Text
    offered_qos_profiles: str | list[Any] = ""
    type_description_hash: _Text = ""


class _TopicCount(_Part):
    topic_metadata: _TopicMetadata
    message_count: _Count


class _Information(_Part):
    """Keys that this package reads from metadata, of any version."""

    version: Annotated[int, Field(strict=True, ge=1, le=VERSION)]
    storage_identifier: _Text
    relative_file_paths: list[_FileName]
    starting_time: _Start
    duration: _Duration
    message_count: _Count
    topics_with_message_count: list[_TopicCount]
    compression_format: str | None = ""
    compression_mode: str | None = ""
    files: list[_File] | None = None
    custom_data: Any = None
    ros_distro: str | None = ""


@dataclass(slots=True)
class FileSpan:
    """One storage file's messages: times of the first and last one, ns, and their number."""

    name: str
    start_ns: int = LATEST_NS
    end_ns: int = 0
    count: int = 0

    def add(self, start_ns: int, end_ns: int, count: int) -> None:
        """Count messages, the first and last of which were received at these times, ns."""
        self.start_ns = min(self.start_ns, start_ns)
        self.end_ns = max(self.end_ns, end_ns)
        self.count += count


def bag_information(
    storage: str,
    files: Sequence[FileSpan],
    topics: Iterable[StoredTopic],
    finished: bool,
) -> dict[str, Any]:
    """Return the fields below ``rosbag2_bagfile_information``.

    As rosbag2 does, a bag or file without messages starts at 2⁶³ - 1 ns, the largest time that it
    has, and lasts 0 ns.

    Args:
        storage: ``mcap`` or ``sqlite3``.
        files: in the order they were written.
        topics: with the number of their messages.
        finished: False while there is more to come.
    """
    start = min((file.start_ns for file in files), default=LATEST_NS)
    end = max((file.end_ns for file in files), default=0)
    return {
        "version": VERSION,
        "storage_identifier": storage,
        "duration": _duration(start, end),
        "starting_time": {"nanoseconds_since_epoch": start},
        "message_count": sum(file.count for file in files),
        "topics_with_message_count": [
            {
                "topic_metadata": {
                    "name": topic.name,
                    "type": topic.type,
                    "serialization_format": "cdr",
                    "offered_qos_profiles": dump_qos_v9(list(topic.offered)),
                    "type_description_hash": topic.type_hash,
                },
                "message_count": topic.count,
            }
            for topic in topics
        ],
        "compression_format": "",
        "compression_mode": "",
        "relative_file_paths": [file.name for file in files],
        "files": [
            {
                "path": file.name,
                "starting_time": {"nanoseconds_since_epoch": file.start_ns},
                "duration": _duration(file.start_ns, file.end_ns),
                "message_count": file.count,
            }
            for file in files
        ],
        "custom_data": None if finished else dict([UNFINISHED]),
        "ros_distro": DISTRIBUTION,
    }


def write_metadata(folder: Path, information: Mapping[str, Any]) -> None:
    """Write ``metadata.yaml`` so that a reader finds either the old one or the new one.

    Raises:
        OSError: it cannot be written; the old one is left as it was.
    """
    temporary = folder / f"{FILE_NAME}.tmp"
    try:
        temporary.write_text(as_yaml({ROOT: dict(information)}) + "\n", encoding="utf-8")
        temporary.replace(folder / FILE_NAME)
    except OSError:
        temporary.unlink(missing_ok=True)
        raise


def load_metadata(folder: Path) -> dict[str, Any]:
    """Return the fields of a folder's metadata.

    Raises:
        FileError: not there, not YAML within limits, or not metadata of a bag.
    """
    path = folder / FILE_NAME
    found = read_yaml(read_text(path, SIZE_LIMIT), str(path))
    information = found.get(ROOT) if isinstance(found, dict) else None
    if not isinstance(information, dict):
        raise FileError(str(path), found, f"must have a mapping {ROOT}")
    try:
        _Information.model_validate(information)
    except ValidationError as error:
        item = error.errors()[0]
        where = ".".join(map(str, item["loc"]))
        raise FileError(str(path), item["input"], item["msg"], where) from None
    return information


def read_metadata(folder: Path) -> dict[str, Any]:
    """Return the fields of a folder's metadata; empty if there are none that can be read."""
    try:
        return load_metadata(folder)
    except FileError:
        return {}


def topics_of(information: Mapping[str, Any]) -> list[StoredTopic]:
    """Return the topics in the fields of metadata, with the counts of their messages.

    Raises:
        DamageError: profiles that cannot be read.
    """
    found = []
    for number, one in enumerate(information["topics_with_message_count"]):
        told = one["topic_metadata"]
        type_hash = told.get("type_description_hash", "")
        offered = read_offers(told.get("offered_qos_profiles") or [])
        kinds = told["name"], told["type"], NO_DEFINITION, type_hash, offered
        found.append(StoredTopic(number, *kinds, one["message_count"]))
    return found


def is_unfinished(information: Mapping[str, Any]) -> bool:
    """Return whether metadata marks an unfinished recording."""
    custom = information.get("custom_data")
    return isinstance(custom, dict) and custom.get(UNFINISHED[0]) == UNFINISHED[1]


def losses_as_data(lost: Mapping[str, int | None]) -> dict[str, str] | None:
    """Return ``custom_data`` with the number of messages of each topic that a recording has lost.

    Only topics with lost messages, or possibly lost ones, and ``lost`` for all; texts, as rosbag2
    requires. None if losses were not counted.
    """
    if not lost:
        return None
    known = [count for count in lost.values() if count is not None]
    some = {name: count for name, count in sorted(lost.items()) if count != 0}
    told = {f"{LOST} {name}": UNKNOWN if n is None else str(n) for name, n in some.items()}
    return {LOST: str(sum(known)), **told}


def losses_of(information: Mapping[str, Any]) -> dict[str, int | None] | None:
    """Return the losses that :func:`losses_as_data` has written, by topic; None: unknown.

    Returns:
        By topic; None if losses were not counted.
    """
    data = information.get("custom_data")
    if not isinstance(data, Mapping) or LOST not in data:
        return None
    told = {str(key).partition(" ")[2]: str(value) for key, value in data.items()}
    return {
        name: int(text) if text.isdecimal() else None
        for name, text in told.items()
        if name.startswith("/")
    }


def as_yaml(value: object) -> str:
    """Return a value as block YAML."""
    yaml = YAML(typ="safe")
    yaml.default_flow_style = False
    yaml.width = 4096
    stream = StringIO()
    yaml.dump(value, stream)
    return stream.getvalue().strip()


def _duration(start_ns: int, end_ns: int) -> dict[str, int]:
    return {"nanoseconds": max(0, end_ns - start_ns)}
