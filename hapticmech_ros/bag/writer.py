"""Writes rosbag2 files from serialized messages."""

from __future__ import annotations

import os
import sqlite3
import threading
from collections.abc import Mapping
from pathlib import Path
from types import TracebackType
from typing import Any, Literal

from rosbags.interfaces import Connection
from rosbags.rosbag2 import CompressionMode, StoragePlugin, Writer, WriterError
from rosbags.rosbag2.storage_mcap import McapWriter
from rosbags.rosbag2.storage_sqlite3 import Sqlite3Writer
from rosbags.typesys import Stores, TypesysError, get_typestore

from hapticmech_ros.bag.offered_qos import offered_qos
from hapticmech_ros.errors import BagError

STORAGES = {"mcap": StoragePlugin.MCAP, "sqlite3": StoragePlugin.SQLITE3}
VERSION: Literal[9] = 9


class _SqliteWriter(Sqlite3Writer):
    """Storage that any thread may use, one at a time; :class:`BagWriter`'s lock sees to that."""

    def __init__(self, path: Path, compression: CompressionMode) -> None:
        super().__init__(path, compression)
        self.conn.close()
        self.conn = sqlite3.connect(f"file:{self.path}", uri=True, check_same_thread=False)
        self.cursor = self.conn.cursor()


class _Writer(Writer):
    STORAGE_PLUGINS: Mapping[StoragePlugin, Any] = {
        StoragePlugin.SQLITE3: _SqliteWriter,
        StoragePlugin.MCAP: McapWriter,
    }


class BagWriter:
    """A rosbag2 folder being written; may be used from any thread.

    The bag is complete only after :meth:`close`. As a context manager it closes at the end, also
    when an error passes through, so that what was recorded until then can be read.

    Args:
        path: folder to make; its parents are made too.
        storage: ``mcap`` or ``sqlite3``.

    Raises:
        BagError: something is there already, unknown storage, or no permission to write.
    """

    def __init__(self, path: str | os.PathLike[str], storage: str = "mcap") -> None:
        if storage not in STORAGES:
            raise BagError(f"storage {storage!r}: must be one of {sorted(STORAGES)}")
        self.path = Path(path)
        self._typestore = get_typestore(Stores.ROS2_JAZZY)
        self._connections: dict[str, Connection] = {}
        self._lock = threading.Lock()
        self._closed = False
        try:
            self._writer = _Writer(self.path, version=VERSION, storage_plugin=STORAGES[storage])
            self._writer.open()
        except (WriterError, OSError, sqlite3.Error) as error:
            raise BagError(f"cannot write bag {self.path}: {error}") from None

    def add_topic(self, name: str, msgtype: str, qos_name: str = "stream") -> None:
        """Announce a topic.

        Args:
            name: absolute topic name.
            msgtype: such as ``geometry_msgs/msg/PoseStamped``; one of the types of ROS 2 Jazzy.
            qos_name: ``qos`` of the topic in wire/topics.py.

        Raises:
            BagError: topic already announced, unknown type or profile, or bag closed.
        """
        profile = offered_qos(qos_name)
        with self._lock:
            self._check_open()
            if name in self._connections:
                raise BagError(f"bag {self.path}: topic {name} is already there")
            try:
                self._connections[name] = self._writer.add_connection(
                    name, msgtype, typestore=self._typestore, offered_qos_profiles=[profile]
                )
            except (KeyError, TypesysError):
                rule = "not a message type of ROS 2 Jazzy"
                raise BagError(f"bag {self.path}: {msgtype!r} of {name}: {rule}") from None

    def write(self, name: str, time_ns: int, data: bytes | memoryview) -> None:
        """Write one serialized message (CDR with its four-byte header), received at ``time_ns``.

        Raises:
            BagError: topic not announced, bag closed, or storage full.
        """
        with self._lock:
            self._check_open()
            connection = self._connections.get(name)
            if connection is None:
                raise BagError(f"bag {self.path}: topic {name} was not announced")
            try:
                self._writer.write(connection, time_ns, data)
            except (WriterError, OSError, sqlite3.Error) as error:
                raise BagError(f"cannot write bag {self.path}: {error}") from error

    def close(self) -> None:
        """Write index and metadata; does nothing the second time.

        Raises:
            BagError: storage full.
        """
        with self._lock:
            if self._closed:
                return
            self._closed = True
            try:
                self._writer.close()
            except (WriterError, OSError, sqlite3.Error) as error:
                raise BagError(f"cannot finish bag {self.path}: {error}") from error

    @property
    def counts(self) -> dict[str, int]:
        """Messages written so far, by topic."""
        return {n: self._writer.counts[c.id] for n, c in self._connections.items()}

    def _check_open(self) -> None:
        if self._closed:
            raise BagError(f"bag {self.path} is closed")

    def __enter__(self) -> BagWriter:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()
