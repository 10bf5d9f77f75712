"""The ``metadata.yaml`` of a rosbag2 folder, version 9, as ROS 2 Jazzy writes it.

While a bag is being recorded its metadata says so under ``custom_data``, which rosbag2 ignores.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from io import StringIO
from pathlib import Path
from typing import Any, Literal, cast

from rosbags.interfaces import Connection, ConnectionExtRosbag2
from rosbags.rosbag2.metadata import dump_qos_v9
from ruamel.yaml import YAML
from ruamel.yaml.error import YAMLError

VERSION: Literal[9] = 9
DISTRIBUTION = "jazzy"
FILE_NAME = "metadata.yaml"
ROOT = "rosbag2_bagfile_information"
# Key and value in custom_data while the writer is still at it.
UNFINISHED = ("recording", "unfinished")
# rosbag2's starting time of a bag, or file, that has no message.
NEVER_NS = 2**63 - 1


@dataclass(slots=True)
class FileSpan:
    """What one storage file holds: times of its first and last message, ns, and their number."""

    name: str
    start_ns: int = NEVER_NS
    end_ns: int = 0
    count: int = 0

    def add(self, time_ns: int) -> None:
        """Count one more message."""
        self.start_ns = min(self.start_ns, time_ns)
        self.end_ns = max(self.end_ns, time_ns)
        self.count += 1


def bag_information(
    storage: str,
    files: Sequence[FileSpan],
    topics: Iterable[tuple[Connection, int]],
    finished: bool,
) -> dict[str, Any]:
    """Return the fields below ``rosbag2_bagfile_information``.

    Args:
        storage: ``mcap`` or ``sqlite3``.
        files: in the order they were written.
        topics: connection and number of messages of each topic.
        finished: False while there is more to come.
    """
    start = min((file.start_ns for file in files), default=NEVER_NS)
    end = max((file.end_ns for file in files), default=0)
    return {
        "version": VERSION,
        "storage_identifier": storage,
        "duration": _duration(start, end),
        "starting_time": {"nanoseconds_since_epoch": start},
        "message_count": sum(file.count for file in files),
        "topics_with_message_count": [_topic(connection, n) for connection, n in topics],
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
    """Write ``metadata.yaml`` so that a reader finds either the old one or the new one."""
    temporary = folder / f"{FILE_NAME}.tmp"
    temporary.write_text(as_yaml({ROOT: dict(information)}) + "\n", encoding="utf-8")
    temporary.replace(folder / FILE_NAME)


def read_metadata(folder: Path) -> dict[str, Any]:
    """Return the fields of a folder's metadata; empty if there are none that can be read."""
    try:
        text = (folder / FILE_NAME).read_text(encoding="utf-8")
        found = YAML(typ="safe").load(text)
    except (OSError, UnicodeDecodeError, YAMLError):
        return {}
    information = found.get(ROOT) if isinstance(found, dict) else None
    return information if isinstance(information, dict) else {}


def is_unfinished(information: Mapping[str, Any]) -> bool:
    """Return whether metadata says that its writer has not come to the end."""
    custom = information.get("custom_data")
    return isinstance(custom, dict) and custom.get(UNFINISHED[0]) == UNFINISHED[1]


def is_recording(folder: Path) -> bool:
    """Return whether a folder's metadata says that it is being recorded, or was cut short.

    A finished bag says so nowhere, which is seen without taking its YAML apart.
    """
    try:
        text = (folder / FILE_NAME).read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError):
        return False
    return UNFINISHED[1] in text and is_unfinished(read_metadata(folder))


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


def _topic(connection: Connection, count: int) -> dict[str, Any]:
    extra = cast(ConnectionExtRosbag2, connection.ext)
    return {
        "topic_metadata": {
            "name": connection.topic,
            "type": connection.msgtype,
            "serialization_format": extra.serialization_format,
            "offered_qos_profiles": dump_qos_v9(list(extra.offered_qos_profiles)),
            "type_description_hash": connection.digest,
        },
        "message_count": count,
    }
