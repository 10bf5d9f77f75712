# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What a bag's SQLite file says, read on the understanding that its tables are plain ones.

Views, triggers, virtual tables and computed columns run code of the file's author, which need not
end. A damaged tree of pages may lead in circles, so that steps and messages are counted as well.

A file of a folder is opened without counting its messages. The library counts them by topic
whenever it opens a file, which reads all of it; of a folder the counts stand in ``metadata.yaml``,
and are taken from there.
"""

from __future__ import annotations

import io
import struct
from collections.abc import Callable, Collection, Generator, Iterable
from pathlib import Path
from typing import Any

from rosbags.interfaces import Connection, ConnectionExtRosbag2, MessageDefinition
from rosbags.rosbag2.errors import ReaderError
from rosbags.rosbag2.metadata import ReaderMetadata
from rosbags.rosbag2.storage_sqlite3 import Sqlite3Reader

from hapticmech_ros.bag.metadata import read_offers
from hapticmech_ros.bag.scan import FORMATS, NO_DEFINITION, UNPACKED_LIMIT, FoundTopic
from hapticmech_ros.files import check_file, is_file, open_file

Execute = Callable[[str], Iterable[tuple[Any, ...]]]

# Steps of SQLite's machine that a query may take: for any file, and for each byte of it. A row has
# 20 bytes at least, and takes some 40 steps where it is counted and sorted.
STEPS, STEPS_PER_BYTE = 20_000_000, 20
# How many steps SQLite takes before it asks whether to go on.
STEPS_AT_ONCE = 100_000
# Bytes that a row has besides its message, at least.
ROW = 4


# Of the first page: its head; place of the size of a page, of which 1 is 65536.
HEAD = 100
_PAGE_SIZE, _PAGE_SIZE_AT, _LARGEST_PAGE = struct.Struct(">H"), 16, 65536


def page_size(head: bytes) -> int:
    """Return the bytes of a page.

    Args:
        head: the first 100 bytes of the file.
    """
    (size,) = _PAGE_SIZE.unpack_from(head, _PAGE_SIZE_AT)
    return _LARGEST_PAGE if size == 1 else int(size)


class Steps:
    """Counts SQLite's steps; it asks :meth:`too_many` every ``STEPS_AT_ONCE`` of them.

    Args:
        size: of the file, bytes.
    """

    def __init__(self, size: int) -> None:
        self._most = STEPS + STEPS_PER_BYTE * size
        self._taken = 0

    def renew(self) -> None:
        """Begin to count anew, for the next query."""
        self._taken = 0

    def too_many(self) -> bool:
        """Return whether the query has to end."""
        self._taken += STEPS_AT_ONCE
        return self._taken > self._most


def refuse_strange_tables(execute: Execute) -> None:
    """Refuse a file of which reading could run something.

    Raises:
        ReaderError: it has something else than plain tables and indices, or lacks what a bag has.
    """
    tables = set()
    for kind, name, text in execute("SELECT type, name, sql FROM sqlite_master"):
        words = str(text or "").upper().split()
        if kind == "table" and words[:2] != ["CREATE", "VIRTUAL"]:
            tables.add(name)
        elif kind != "index" or "(" in str(text or "").partition("(")[2]:
            raise ReaderError(f"it has something else than plain tables: {kind} {str(name)[:80]!r}")
    if not {"messages", "topics"} <= tables:
        raise ReaderError("it has no tables 'messages' and 'topics'")
    for name in ("messages", "topics", "message_definitions", "schema"):
        if any(row[6] for row in execute(f"PRAGMA table_xinfo({name})")):
            raise ReaderError(f"table {name!r} has computed columns")


def stored_topics(execute: Execute) -> dict[int, tuple[FoundTopic, str]]:
    """Return topics and their serialization formats by number; of every version of the tables.

    Raises:
        ReaderError: a value is not what it should be.
    """
    have = {row[1] for row in execute("PRAGMA table_info(topics)")}
    optional = [
        name if name in have else f"'' AS {name}"
        for name in ("offered_qos_profiles", "type_description_hash")
    ]
    query = f"SELECT id, name, type, serialization_format, {', '.join(optional)} FROM topics"
    definitions = _definitions(execute)
    found = {}
    for number, *said in execute(f"{query} ORDER BY id"):
        name, msgtype, serialization, offered, type_hash = _texts("topics", said)
        definition = definitions.get(msgtype, NO_DEFINITION)
        topic = FoundTopic(name, msgtype, definition, type_hash, read_offers(offered))
        found[number] = topic, serialization
    return found


def checked_message(row: tuple[Any, ...]) -> tuple[int, int, bytes]:
    """Return a row of messages: number of the topic, time (ns), bytes.

    Raises:
        ReaderError: a value is not what it should be.
    """
    number, time_ns, data = row
    if type(number) is int and type(time_ns) is int and time_ns >= 0 and isinstance(data, bytes):
        return number, time_ns, data
    raise ReaderError("table 'messages' has a row that is no message")


def _definitions(execute: Execute) -> dict[str, MessageDefinition]:
    if not list(execute("PRAGMA table_info(message_definitions)")):
        return {}
    query = "SELECT topic_type, encoding, encoded_message_definition FROM message_definitions"
    found: dict[str, MessageDefinition] = {}
    for row in execute(query):
        msgtype, encoding, text = _texts("message_definitions", list(row))
        if encoding in FORMATS:
            found.setdefault(msgtype, MessageDefinition(FORMATS[encoding], text))
    return found


def _texts(table: str, values: list[Any]) -> list[str]:
    """Return values that have to be texts; none is empty text."""
    found = ["" if value is None else value for value in values]
    for value in found:
        if not isinstance(value, str):
            raise ReaderError(f"table {table!r} has {str(value)[:80]!r} where it must have text")
    return found


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
