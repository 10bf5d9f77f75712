# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The library's reader, with readers of storage files that cost what is wanted of them.

They believe nothing that a file says of itself: its sizes, its names, its types.
"""

from __future__ import annotations

from collections.abc import Collection, Generator
from contextlib import ExitStack, suppress
from pathlib import Path, PurePosixPath
from tempfile import TemporaryDirectory
from types import MappingProxyType
from typing import Any

from rosbags.highlevel import AnyReader
from rosbags.interfaces import Connection, ConnectionExtRosbag2
from rosbags.rosbag2 import ReaderError
from rosbags.rosbag2.metadata import ReaderMetadata
from rosbags.rosbag2.reader import DirectoryReader, Reader
from rosbags.typesys import Stores, get_typestore

from hapticmech_ros.bag.metadata import load_metadata, read_offers
from hapticmech_ros.bag.scan import NO_DEFINITION, unpack_file, unpacked
from hapticmech_ros.bag.scan_mcap import WantedMcap
from hapticmech_ros.bag.tables import CountedSqlite, WantedSqlite
from hapticmech_ros.files import exists

_NEVER = 2**63 - 1
# Of the definitions of all topics, which the library understands at some 30 us a line.
DEFINITIONS_SIZE, DEFINITIONS_LINES = 4_000_000, 200_000


class _Folder(DirectoryReader):
    # Counts are those of metadata.yaml.
    STORAGE_PLUGINS = MappingProxyType({"mcap": WantedMcap, "sqlite3": WantedSqlite})

    def open(self) -> None:
        """Open all files that the metadata name."""
        self.stack = ExitStack()
        try:
            self._open(self.stack)
        except BaseException:
            with suppress(Exception):
                self.close()
            raise

    def _open(self, stack: ExitStack) -> None:
        said = load_metadata(Path(str(self.path)))
        plugin = self.STORAGE_PLUGINS.get(said["storage_identifier"])
        if plugin is None:
            raise ReaderError(f"storage {said['storage_identifier']!r} is not supported")
        mode = str(said.get("compression_mode") or "none").lower()
        if mode != "none" and said.get("compression_format") != "zstd":
            raise ReaderError(f"compression {said.get('compression_format')!r} is not supported")
        names = [PurePosixPath(name).name for name in said["relative_file_paths"]]
        paths = [Path(str(self.path)) / name for name in names]
        missing = [path.name for path in paths if not exists(path)]
        if missing:
            raise ReaderError(f"files are missing: {missing}")
        self.connections = [
            _connection(number, entry, self)
            for number, entry in enumerate(said["topics_with_message_count"], start=1)
        ]
        strange = {
            str(entry["topic_metadata"]["serialization_format"])
            for entry in said["topics_with_message_count"]
        } - {"cdr"}
        if strange:
            raise ReaderError(f"serialization {sorted(strange)} is not supported")
        if mode == "file":
            paths = _plain(paths, Path(stack.enter_context(TemporaryDirectory())))
        self.storages = []
        for path in paths:
            storage = plugin(path)
            storage.open()
            stack.callback(storage.close)
            self.storages.append(storage)
        self.metadata = _times(said, mode, self.storages)
        definitions = {
            one.msgtype: one.msgdef
            for storage in reversed(self.storages)
            for one in reversed(storage.connections)
            if one.msgdef.format != NO_DEFINITION.format
        }
        self.connections = [
            one._replace(msgdef=definitions.get(one.msgtype, one.msgdef))
            for one in self.connections
        ]
        self._packed = mode == "message"

    def messages(
        self,
        connections: Collection[Connection],
        start: int | None = None,
        stop: int | None = None,
    ) -> Generator[tuple[Connection, int, bytes], None, None]:
        """Yield connection, time (ns) and bytes of messages, file by file.

        Topics are those of the files by name and type: what metadata say of their QoS may have been
        edited, which the library takes for another topic.
        """
        known = {(one.topic, one.msgtype): one for one in connections}
        for storage in self.storages:
            found = {
                one.id: known[one.topic, one.msgtype]
                for one in storage.connections
                if (one.topic, one.msgtype) in known
            }
            stored = [one for one in storage.connections if one.id in found]
            if not stored:
                continue
            for connection, time_ns, data in storage.messages(stored, start, stop):
                plain = unpacked(data, "zstd") if self._packed else data
                yield found[connection.id], time_ns, plain


class _Bag(Reader):
    # Of a file alone the messages are counted.
    STORAGE_PLUGINS = MappingProxyType({"dir": _Folder, ".mcap": WantedMcap, ".db3": CountedSqlite})

    def open(self) -> None:
        """Open the bag, unless the definitions of its types would take long to understand."""
        super().open()
        texts = [connection.msgdef.data for connection in self.connections]
        size, lines = sum(map(len, texts)), sum(text.count("\n") for text in texts)
        if size > DEFINITIONS_SIZE or lines > DEFINITIONS_LINES:
            self.close()
            rule = f"at most {DEFINITIONS_SIZE} characters in {DEFINITIONS_LINES} lines"
            raise ReaderError(f"its types' definitions have {size} in {lines}: {rule}")


def any_reader(path: Path) -> AnyReader:
    """Return a reader of a rosbag2 folder or storage file, not yet open.

    Raises:
        Exception: of the library; no such bag, or of another kind.
    """
    reader = AnyReader([path], default_typestore=get_typestore(Stores.ROS2_JAZZY))
    reader.readers = [_Bag(path)]
    return reader


def number_of_files(reader: AnyReader) -> int:
    """Return how many storage files an open reader reads."""
    return sum(
        len(one.storage.storages) if isinstance(one.storage, DirectoryReader) else 1
        for one in reader.readers
        if isinstance(one, Reader)
    )


def _connection(number: int, entry: dict[str, Any], owner: DirectoryReader) -> Connection:
    said = entry["topic_metadata"]
    offered = read_offers(said.get("offered_qos_profiles") or [])
    return Connection(
        number,
        said["name"],
        said["type"],
        NO_DEFINITION,
        said.get("type_description_hash", ""),
        entry["message_count"],
        ConnectionExtRosbag2(said["serialization_format"], list(offered)),
        owner,
    )


def _times(said: dict[str, Any], mode: str, storages: Collection[Any]) -> ReaderMetadata:
    """Return what the library says of a bag; messages are unpacked here, not there.

    Times are those of the files: metadata of bags without messages, or that were cut short, have
    2⁶³ - 1 ns or nothing where a time should be. A file of SQLite is not counted, and without
    messages has no times.
    """
    found = [
        one.metadata
        for one in storages
        if one.metadata.start_time < one.metadata.end_time
        and (one.metadata.message_count or isinstance(one, WantedSqlite))
    ]
    start = min((one.start_time for one in found), default=_NEVER)
    end = max((one.end_time for one in found), default=0)
    return ReaderMetadata(
        duration=max(0, end - start),
        start_time=start,
        end_time=end,
        message_count=said["message_count"],
        compression_format=said.get("compression_format") or None,
        compression_mode=mode if mode == "file" else None,
        ros_distro=said.get("ros_distro"),
        custom=said.get("custom_data"),
    )


def _plain(paths: list[Path], folder: Path) -> list[Path]:
    """Return files that were compressed as a whole, unpacked into a folder."""
    found = []
    for path in paths:
        found.append(folder / path.stem)
        trouble = unpack_file(path, found[-1])
        if trouble:
            raise ReaderError(f"{path.name} {trouble}")
    return found
