# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Writes rosbag2 folders from serialized messages: one file, or several by size or duration."""

from __future__ import annotations

import os
import sqlite3
import threading
from collections.abc import Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from types import MappingProxyType

from rosbags.interfaces import MessageDefinition, MessageDefinitionFormat, Qos
from rosbags.rosbag2.metadata import dump_qos_v9
from rosbags.typesys import Stores, TypesysError, get_typestore

from hapticmech_ros.bag.mcap_file import McapFile
from hapticmech_ros.bag.metadata import (
    VERSION,
    FileSpan,
    as_yaml,
    bag_information,
    losses_as_data,
    offered_qos,
    write_metadata,
)
from hapticmech_ros.bag.sqlite_file import SqliteFile
from hapticmech_ros.bag.storage import Messages, StoredTopic
from hapticmech_ros.errors import BagError, listed

# Messages older than this, by their times, are on disk if the writer is killed.
FLUSH_NS = 500_000_000
StorageFile = McapFile | SqliteFile
STORAGE_FILES: dict[str, type[StorageFile]] = {"mcap": McapFile, "sqlite3": SqliteFile}
_FAILURES = (OSError, sqlite3.Error)


class BagWriter(AbstractContextManager["BagWriter"]):
    """A rosbag2 folder being written; may be used from any thread.

    The bag is complete only after :meth:`close`. As a context manager it closes at the end, also
    after an error: messages recorded until then can be read. If a writer is killed, ``hapticmech
    bag repair`` recovers all but the last half second.

    Args:
        path: folder to make; its parents are made too.
        storage: ``mcap`` or ``sqlite3``.
        split_bytes: begin a new file once the present one is that large.
        split_ns: begin a new file once the present one spans more than that, ns.

    Raises:
        BagError: something is there already, unknown storage, a limit that is not positive, or no
            permission to write.
    """

    def __init__(
        self,
        path: str | os.PathLike[str],
        storage: str = "mcap",
        *,
        split_bytes: int | None = None,
        split_ns: int | None = None,
    ) -> None:
        if storage not in STORAGE_FILES:
            raise BagError(f"storage {storage!r}: must be one of {listed(sorted(STORAGE_FILES))}")
        for limit in (split_bytes, split_ns):
            if limit is not None and limit <= 0:
                raise BagError(f"limit of a file's size or duration, {limit}: must be positive")
        self.path = Path(path)
        self._storage = storage
        self._split_bytes, self._split_ns = split_bytes, split_ns
        self._typestore = get_typestore(Stores.ROS2_JAZZY)
        self._topics: dict[str, StoredTopic] = {}
        self._counts: dict[str, int] = {}
        self._files: list[FileSpan] = []
        self._flushed_ns: int | None = None
        self._stale = False
        self._lock = threading.Lock()
        self._closed = False
        try:
            self.path.mkdir(parents=True)
            self._open_file()
            self._save_metadata()
        except FileExistsError:
            rule = "exists already, not overwriting"
            raise BagError(f"cannot write bag {self.path}: {rule}") from None
        except _FAILURES as error:
            raise BagError(f"cannot write bag {self.path}: {error}") from None

    def add_topic(
        self,
        name: str,
        msgtype: str,
        qos_name: str = "stream",
        *,
        offered: Sequence[Qos] | None = None,
        definition: tuple[MessageDefinition, str] | None = None,
    ) -> None:
        """Announce a topic.

        Args:
            name: absolute topic name.
            msgtype: such as ``geometry_msgs/msg/PoseStamped``; one of the types of ROS 2 Jazzy,
                unless ``definition`` is given.
            qos_name: ``qos`` of the topic in wire/topics.py.
            offered: QoS profile of each of its publishers, instead of ``qos_name``'s.
            definition: of the message type, with its hash (``RIHS01_...``).

        Raises:
            BagError: topic already announced, unknown type or profile, or bag closed.
        """
        profiles = [offered_qos(qos_name)] if offered is None else list(offered)
        with self._writing():
            if name in self._topics:
                raise BagError(f"bag {self.path}: topic {name} is already there")
            text, type_hash = definition or self._definition(name, msgtype)
            number = len(self._topics) + 1
            topic = StoredTopic(number, name, msgtype, text, type_hash, tuple(profiles))
            self._announce(topic)
            self._topics[name] = topic
            self._counts[name] = 0
            self._stale = True

    def write(self, name: str, time_ns: int, data: bytes | memoryview) -> None:
        """Write one serialized message (CDR with its four-byte header), received at ``time_ns``.

        Raises:
            BagError: as :meth:`write_many`.
        """
        self.write_many(name, [(time_ns, data)])

    def write_many(self, name: str, messages: Messages) -> None:
        """Write serialized messages of one topic: times of reception, ns, and bytes.

        Together they go into one file.

        Raises:
            BagError: topic not announced, bag closed, or storage full.
        """
        if not messages:
            return
        with self._writing():
            topic = self._topics.get(name)
            if topic is None:
                raise BagError(f"bag {self.path}: topic {name} was not announced")
            time_ns = messages[0][0]
            if self._is_full(time_ns):
                self._next_file()
            self._file.write_many(topic.number, messages)
            self._counts[name] += len(messages)
            times = [time_ns for time_ns, _ in messages]
            self._files[-1].add(min(times), max(times), len(times))
            if self._flushed_ns is None:
                self._flushed_ns = time_ns
            elif abs(time_ns - self._flushed_ns) >= FLUSH_NS:
                self._flushed_ns = time_ns
                self._flush()

    def flush(self) -> None:
        """Put all that was written where the death of this process cannot lose it.

        Raises:
            BagError: bag closed, or storage full.
        """
        with self._writing():
            self._flush()

    def split(self) -> None:
        """Begin a new file, unless the present one is empty.

        Raises:
            BagError: bag closed, or storage full.
        """
        with self._writing():
            if self._files[-1].count:
                self._next_file()

    def close(self, lost: Mapping[str, int | None] = MappingProxyType({})) -> None:
        """Write index and metadata; does nothing the second time.

        Args:
            lost: messages of each topic that were lost before they came here, where that was
                counted; None: not known. It stands in the metadata's ``custom_data``.

        Raises:
            BagError: storage full.
        """
        with self._lock:
            if self._closed:
                return
            self._closed = True
            information = self._information(finished=True) | {"custom_data": losses_as_data(lost)}
            try:
                self._file.close(VERSION, as_yaml(information))
                write_metadata(self.path, information)
            except _FAILURES as error:
                raise BagError(f"cannot finish bag {self.path}: {error}") from error

    @property
    def counts(self) -> dict[str, int]:
        """Messages written so far, by topic."""
        return dict(self._counts)

    def __exit__(self, *_: object) -> None:
        self.close()

    @contextmanager
    def _writing(self) -> Iterator[None]:
        """Keep other threads out, refuse a closed bag, and report storage's errors."""
        with self._lock:
            if self._closed:
                raise BagError(f"bag {self.path} is closed")
            try:
                yield
            except _FAILURES as error:
                raise BagError(f"cannot write bag {self.path}: {error}") from error

    def _definition(self, name: str, msgtype: str) -> tuple[MessageDefinition, str]:
        try:
            text, _ = self._typestore.generate_msgdef(msgtype, ros_version=2)
            digest = self._typestore.hash_rihs01(msgtype)
        except (KeyError, TypesysError):
            rule = "not a message type of ROS 2 Jazzy"
            raise BagError(f"bag {self.path}: {msgtype!r} of {name}: {rule}") from None
        return MessageDefinition(MessageDefinitionFormat.MSG, text), digest

    def _announce(self, topic: StoredTopic) -> None:
        if topic.type not in self._types_in_file:
            self._types_in_file.add(topic.type)
            self._file.add_type(topic)
        self._file.add_topic(topic, _offered_yaml(topic.offered))

    def _is_full(self, time_ns: int) -> bool:
        span = self._files[-1]
        if not span.count:
            return False
        if self._split_ns is not None and time_ns - span.start_ns > self._split_ns:
            return True
        return self._split_bytes is not None and self._file.size() >= self._split_bytes

    def _open_file(self) -> None:
        stem = f"{self.path.name}_{len(self._files)}"
        self._file: StorageFile = STORAGE_FILES[self._storage](self.path, stem)
        self._types_in_file: set[str] = set()
        self._files.append(FileSpan(self._file.path.name))
        for topic in self._topics.values():
            self._announce(topic)

    def _next_file(self) -> None:
        self._file.close(VERSION, as_yaml(self._information(finished=True)))
        self._open_file()
        self._save_metadata()

    def _flush(self) -> None:
        self._file.flush()
        if self._stale:
            self._save_metadata()

    def _save_metadata(self) -> None:
        self._stale = False
        write_metadata(self.path, self._information(finished=False))

    def _information(self, finished: bool) -> dict[str, object]:
        topics = [replace(one, count=self._counts[name]) for name, one in self._topics.items()]
        return bag_information(self._storage, self._files, topics, finished)


@lru_cache(maxsize=256)
def _offered_yaml(profiles: tuple[Qos, ...]) -> str:
    """Return publishers' QoS as a storage keeps it; a graph has few different ones."""
    return as_yaml(dump_qos_v9(list(profiles)))
