# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Opens an SQLite file of a bag without believing it, and of a folder without counting messages.

The library counts them by topic whenever it opens a file, which reads all of it; of a folder the
counts stand in ``metadata.yaml``, and are taken from there.
"""

from __future__ import annotations

import io
import struct
from collections.abc import Collection, Generator
from pathlib import Path

from rosbags.interfaces import Connection, ConnectionExtRosbag2
from rosbags.rosbag2.errors import ReaderError
from rosbags.rosbag2.metadata import ReaderMetadata
from rosbags.rosbag2.storage_sqlite3 import Sqlite3Reader

from hapticmech_ros.bag.tables import (
    HEAD,
    ROW,
    STEPS_AT_ONCE,
    Execute,
    Steps,
    checked_message,
    page_size,
    refuse_strange_tables,
    stored_topics,
)
from hapticmech_ros.bag.unpack import UNPACKED_LIMIT
from hapticmech_ros.files import check_file, is_file, open_file

# Of the first page: number of pages.
_PAGES, _PAGES_AT = struct.Struct(">I"), 28
# What SQLite leaves beside a file whose writer did not end well.
_LOGS = {
    "-wal": "a log of messages that are not in it yet",
    "-journal": "what a half-written change has replaced",
}
# SQLITE_LIMIT_LENGTH: of a text, a blob or a row, bytes.
LENGTH = 0


class WantedSqlite(Sqlite3Reader):
    """A file of a folder; as the library's reader, but for counts, which are 0."""

    _counted = False

    def open(self) -> None:
        """Open the file."""
        check_file(str(self.path))
        super().open()

    def _open(self) -> None:
        self._refuse_log()
        self._size = self._refuse_cut()
        database = self.dbconn
        if database is None:
            raise ReaderError(f"{self.path} is not open")
        self._steps = Steps(self._size)
        database.limit(LENGTH, UNPACKED_LIMIT)
        database.set_progress_handler(self._steps.too_many, STEPS_AT_ONCE)
        execute: Execute = database.execute
        refuse_strange_tables(execute)
        counts = self._counts(execute)
        self.connections = [
            Connection(
                number,
                topic.name,
                topic.type,
                topic.definition,
                topic.type_hash,
                counts.get(number, 0),
                ConnectionExtRosbag2(serialization, list(topic.offered)),
                self,
            )
            for number, (topic, serialization) in stored_topics(execute).items()
        ]
        ((first,),) = execute("SELECT MIN(timestamp) FROM messages")
        ((last,),) = execute("SELECT MAX(timestamp) FROM messages")
        if type(first) is int and type(last) is int:
            span = last + 1 - first, first, last + 1
            self.metadata = ReaderMetadata(*span, sum(counts.values()), None, None, None, None)
        elif first is not None:
            raise ReaderError("table 'messages' has a time that is no number")

    def messages(
        self,
        connections: Collection[Connection],
        start: int | None = None,
        stop: int | None = None,
    ) -> Generator[tuple[Connection, int, bytes], None, None]:
        """Yield connection, time (ns) and bytes of messages, in order of time.

        Raises:
            ReaderError: the database is damaged.
        """
        self._steps.renew()
        seen = 0
        for connection, *rest in super().messages(connections, start, stop):
            _, time_ns, data = checked_message((connection.id, *rest))
            seen += len(data) + ROW
            if seen > self._size:
                raise ReaderError(f"{self.path} has more messages than there is room for in it")
            yield connection, time_ns, data

    def _counts(self, execute: Execute) -> dict[int, int]:
        """Return how many messages each topic has; nothing where somebody else has counted."""
        if not self._counted:
            return {}
        return dict(execute("SELECT topic_id, COUNT(*) FROM messages GROUP BY topic_id"))

    def _refuse_log(self) -> None:
        """Refuse a file beside which there is what SQLite would put into it or take out of it.

        It is opened as one that nobody changes, in folders too that nobody can write.
        """
        for suffix, what in _LOGS.items():
            log = f"{self.path}{suffix}"
            if is_file(log) and Path(log).stat().st_size > 0:
                rule = f"its writer has left {Path(log).name} beside it"
                raise ReaderError(f"{self.path} is not whole: {rule}, {what}")

    def _refuse_cut(self) -> int:
        """Refuse a file that is shorter than its first page says; return its size, bytes."""
        with open_file(str(self.path)) as file:
            head = file.read(HEAD)
            size = file.seek(0, io.SEEK_END)
        if len(head) < HEAD:
            raise ReaderError(f"{self.path} is too short to be a database")
        said = _PAGES.unpack_from(head, _PAGES_AT)[0] * page_size(head)
        if said > size:
            raise ReaderError(f"{self.path} has {size} bytes of {said}")
        return size


class CountedSqlite(WantedSqlite):
    """A file alone, whose messages are counted as it is opened."""

    _counted = True
