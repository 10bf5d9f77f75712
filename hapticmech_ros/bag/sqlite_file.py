# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Reads and writes bags' SQLite files; it accepts plain tables only.

Views, triggers, virtual tables and computed columns run code of the file's author, which need not
end. A damaged tree of pages may have cycles: steps and messages are limited as well.
"""

from __future__ import annotations

import io
import shutil
import sqlite3
import struct
import sys
from collections.abc import Callable, Iterable, Iterator, Set
from contextlib import closing
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from rosbags.interfaces import MessageDefinition

from hapticmech_ros.bag.metadata import DISTRIBUTION, read_offers
from hapticmech_ros.bag.storage import (
    FORMATS,
    LATEST_NS,
    NO_DEFINITION,
    UNPACKED_LIMIT,
    DamageError,
    Found,
    Messages,
    StoredTopic,
)
from hapticmech_ros.files import check_file, exists, is_file, open_file

Execute = Callable[[str], Iterable[tuple[Any, ...]]]

# Steps of SQLite's machine that a query may take: for any file, and for each byte of it. A row has
# 20 bytes at least, and takes some 40 steps where it is counted and sorted.
STEPS, STEPS_PER_BYTE = 20_000_000, 20
# How many steps SQLite takes before it asks whether to go on.
STEPS_AT_ONCE = 100_000
# Bytes that a row has besides its message, at least.
ROW = 4


# Of the first page: its head; place of the page size, where 1 stands for 65536.
HEAD = 100
_PAGE_SIZE, _PAGE_SIZE_AT, _LARGEST_PAGE = struct.Struct(">H"), 16, 65536


def page_size(head: bytes) -> int:
    """Return the bytes of a page.

    Args:
        head: the first 100 bytes of the file.
    """
    (size,) = _PAGE_SIZE.unpack_from(head, _PAGE_SIZE_AT)
    return _LARGEST_PAGE if size == 1 else int(size)


def limit_steps(database: sqlite3.Connection, size: int) -> None:
    """Let SQLite interrupt statements of too many steps from now on.

    Args:
        database: open file.
        size: of the file, bytes.
    """
    left = iter(range((STEPS + STEPS_PER_BYTE * size) // STEPS_AT_ONCE))
    database.set_progress_handler(lambda: next(left, None) is None, STEPS_AT_ONCE)


def refuse_strange_tables(execute: Execute) -> None:
    """Refuse a file whose reading could run code.

    Raises:
        DamageError: it has something else than plain tables and indices, or lacks a bag's tables.
    """
    tables = set()
    for kind, name, text in execute("SELECT type, name, sql FROM sqlite_master"):
        words = str(text or "").upper().split()
        if kind == "table" and words[:2] != ["CREATE", "VIRTUAL"]:
            tables.add(name)
        elif kind != "index" or "(" in str(text or "").partition("(")[2]:
            raise DamageError(f"it has something else than plain tables: {kind} {str(name)[:80]!r}")
    if not {"messages", "topics"} <= tables:
        raise DamageError("it has no tables 'messages' and 'topics'")
    for name in ("messages", "topics", "message_definitions", "schema"):
        if any(row[6] for row in execute(f"PRAGMA table_xinfo({name})")):
            raise DamageError(f"table {name!r} has computed columns")


def stored_topics(execute: Execute) -> Iterator[StoredTopic]:
    """Yield topics in order of their numbers; of every version of the tables.

    Raises:
        DamageError: a value of the wrong type.
    """
    have = {row[1] for row in execute("PRAGMA table_info(topics)")}
    optional = [
        name if name in have else f"'' AS {name}"
        for name in ("offered_qos_profiles", "type_description_hash")
    ]
    definitions = _definitions(execute)
    query = f"SELECT id, name, type, serialization_format, {', '.join(optional)} FROM topics"
    for number, *said in execute(f"{query} ORDER BY id"):
        name, msgtype, _, offered, type_hash = _texts("topics", said)
        definition = definitions.get(msgtype, NO_DEFINITION)
        yield StoredTopic(number, name, msgtype, definition, type_hash, read_offers(offered))


def checked_message(row: tuple[Any, ...]) -> tuple[int, int, bytes]:
    """Return a row of messages: number of the topic, time (ns), bytes.

    Raises:
        DamageError: a value of the wrong type.
    """
    number, time_ns, data = row
    if type(number) is int and type(time_ns) is int and time_ns >= 0 and isinstance(data, bytes):
        return number, time_ns, data
    raise DamageError("table 'messages' has a row that is no message")


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
            raise DamageError(f"table {table!r} has {str(value)[:80]!r} where it must have text")
    return found


# Of the first page: number of pages.
_PAGES, _PAGES_AT = struct.Struct(">I"), 28
# Files that SQLite leaves beside a file whose writer crashed.
_LOGS = {
    "-wal": "a log of messages that are not in it yet",
    "-journal": "with the data that a half-written change has replaced",
}


class SqliteReader:
    """A file open for reading; messages are counted on request.

    Attributes:
        path: the file.
        topics: in the order of their numbers.
        span: times of the first message and 1 ns behind the last one; (2⁶³ - 1, 0) without any.

    Raises:
        FileError: no regular file, or it cannot be opened.
        DamageError: damaged, or not whole.
        sqlite3.Error: damaged.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._refuse_log()
        self._size = self._refuse_cut()
        # As an immutable file, also in read-only folders. Threads take turns.
        self._database = sqlite3.connect(
            f"{path.absolute().as_uri()}?mode=ro&immutable=1", uri=True, check_same_thread=False
        )
        try:
            self._open()
        except BaseException:
            self._database.close()
            raise

    def _open(self) -> None:
        execute = self._database.execute
        execute("PRAGMA trusted_schema = OFF")
        # Before Python 3.11 a row may have the 10⁹ bytes of SQLite itself.
        if sys.version_info >= (3, 11):
            self._database.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, UNPACKED_LIMIT)
        limit_steps(self._database, self._size)
        refuse_strange_tables(execute)
        self.topics = tuple(stored_topics(execute))
        ((first,),) = execute("SELECT MIN(timestamp) FROM messages")
        ((last,),) = execute("SELECT MAX(timestamp) FROM messages")
        if first is not None and (type(first) is not int or type(last) is not int):
            raise DamageError("table 'messages' has a time that is no number")
        self.span = (LATEST_NS, 0) if first is None else (first, last + 1)

    def count(self) -> None:
        """Count the messages of each topic, which reads all of the file."""
        query = "SELECT topic_id, COUNT(*) FROM messages GROUP BY topic_id"
        counts = dict(self._database.execute(query))
        self.topics = tuple(replace(one, count=counts.get(one.number, 0)) for one in self.topics)

    def messages(self, wanted: Set[int], start: int, stop: int) -> Iterator[tuple[int, int, bytes]]:
        """Yield topics' numbers, times (ns) and bytes of messages, in order of time.

        Args:
            wanted: numbers of topics.
            start: leave out what was received earlier, ns.
            stop: leave out what was received then or later, ns.

        Raises:
            DamageError: a row is no message, or there are more than fit into the file.
            sqlite3.Error: damaged.
        """
        limit_steps(self._database, self._size)
        seen = 0
        query = (
            "SELECT topic_id, timestamp, data FROM messages"
            f" WHERE topic_id IN ({','.join('?' * len(wanted))})"
            " AND timestamp BETWEEN ? AND ? ORDER BY timestamp"
        )
        limits = min(start, LATEST_NS), min(stop - 1, LATEST_NS)
        for row in self._database.execute(query, (*wanted, *limits)):
            number, time_ns, data = checked_message(row)
            seen += len(data) + ROW
            if seen > self._size:
                raise DamageError("it has more messages than fit into it")
            yield number, time_ns, data

    def close(self) -> None:
        """Close the file."""
        self._database.close()

    def _refuse_log(self) -> None:
        """Refuse a file with a log beside it that SQLite would apply or roll back."""
        for suffix, what in _LOGS.items():
            log = Path(f"{self.path}{suffix}")
            if is_file(log) and log.stat().st_size > 0:
                raise DamageError(f"its writer has left {log.name} beside it, {what}")

    def _refuse_cut(self) -> int:
        """Refuse a file that is shorter than its first page states; return its size, bytes."""
        with open_file(self.path) as file:
            head = file.read(HEAD)
            size = file.seek(0, io.SEEK_END)
        if len(head) < HEAD:
            raise DamageError(f"{self.path.name} is too short to be a database")
        said = _PAGES.unpack_from(head, _PAGES_AT)[0] * page_size(head)
        if said > size:
            raise DamageError(f"{self.path.name} has {size} bytes of {said}")
        return size


class SqliteScan:
    """One pass over a file, damaged or not; what it met stands in its attributes afterwards.

    Opening a database whose writer died changes it and its journal: a copy is opened.

    Args:
        path: of the file.
        scratch: folder for the copy.

    Attributes:
        trouble: why the pass ended early; empty for a whole file.
        lost_bytes: size of what could not be read; what it held is not known.
    """

    def __init__(self, path: Path, scratch: Path) -> None:
        self.path = path
        self._scratch = scratch
        self.trouble = ""
        self.lost_bytes = 0

    def __iter__(self) -> Iterator[Found]:
        """Yield topics, each before its first message, and messages."""
        size = check_file(self.path)
        with TemporaryDirectory(dir=self._scratch) as folder:
            copy = Path(folder) / self.path.name
            shutil.copyfile(self.path, copy)
            _drop_cut_page(copy)
            for suffix in _LOGS:
                journal = self.path.with_name(self.path.name + suffix)
                if exists(journal):
                    size += check_file(journal)
                    shutil.copyfile(journal, copy.with_name(copy.name + suffix))
            read = 0
            try:
                with closing(sqlite3.connect(copy)) as database:
                    database.execute("PRAGMA trusted_schema = OFF")
                    limit_steps(database, size)
                    for found in _rows(database):
                        read += ROW + len(found.data) if found.data is not None else 0
                        if read > size:
                            raise DamageError("it has more messages than fit into it")
                        yield found
            except (sqlite3.Error, DamageError, UnicodeDecodeError) as error:
                self.trouble = f"cannot be read to its end ({error})"
                self.lost_bytes = max(0, size - read)


def _drop_cut_page(path: Path) -> None:
    """Remove a page that was cut: SQLite would read zeros for its missing bytes."""
    with path.open("r+b") as file:
        head = file.read(HEAD)
        size = file.seek(0, io.SEEK_END)
        page = page_size(head) if len(head) == HEAD else 0
        if page and size % page:
            file.truncate(size - size % page)


def _rows(database: sqlite3.Connection) -> Iterator[Found]:
    refuse_strange_tables(database.execute)
    topics = {topic.number: topic for topic in stored_topics(database.execute)}
    for topic in topics.values():
        yield Found(topic)
    # In order of writing, not through the index, which may be what is damaged.
    query = "SELECT topic_id, timestamp, data FROM messages NOT INDEXED ORDER BY id"
    for row in database.execute(query):
        try:
            number, time_ns, data = checked_message(row)
        except DamageError:
            continue
        if number in topics:
            yield Found(topics[number], time_ns, data)


# Tables of version 4, which rosbag2 writes since ROS 2 Jazzy.
_TABLES = f"""
CREATE TABLE schema(schema_version INTEGER PRIMARY KEY, ros_distro TEXT NOT NULL);
CREATE TABLE metadata(
    id INTEGER PRIMARY KEY, metadata_version INTEGER NOT NULL, metadata TEXT NOT NULL);
CREATE TABLE topics(
    id INTEGER PRIMARY KEY, name TEXT NOT NULL, type TEXT NOT NULL,
    serialization_format TEXT NOT NULL, offered_qos_profiles TEXT NOT NULL,
    type_description_hash TEXT NOT NULL);
CREATE TABLE message_definitions(
    id INTEGER PRIMARY KEY, topic_type TEXT NOT NULL, encoding TEXT NOT NULL,
    encoded_message_definition TEXT NOT NULL, type_description_hash TEXT NOT NULL);
CREATE TABLE messages(
    id INTEGER PRIMARY KEY, topic_id INTEGER NOT NULL, timestamp INTEGER NOT NULL,
    data BLOB NOT NULL);
CREATE INDEX timestamp_idx ON messages (timestamp ASC);
INSERT INTO schema(schema_version, ros_distro) VALUES (4, '{DISTRIBUTION}');
"""
# Bytes that SQLite needs for a message besides its own: row, index, unused parts of pages.
ROW_BYTES = 48


class SqliteFile:
    """A file being written, ``folder/stem.db3``, for any thread, one at a time.

    Its journal is written ahead: a commit neither waits for the disk, nor does a kill undo it. A
    closed file has no journal beside it, as readers expect that open it as immutable.
    """

    def __init__(self, folder: Path, stem: str) -> None:
        self.path = folder / f"{stem}.db3"
        self._database = sqlite3.connect(self.path, check_same_thread=False)
        self._database.execute("PRAGMA journal_mode=WAL")
        self._database.execute("PRAGMA synchronous=OFF")
        self._database.executescript(_TABLES)
        self._bytes = 0

    def add_type(self, topic: StoredTopic) -> None:
        """Write the definition of a topic's message type."""
        self._database.execute(
            "INSERT INTO message_definitions VALUES(NULL, ?, ?, ?, ?)",
            (topic.type, topic.encoding, topic.definition.data, topic.type_hash),
        )

    def add_topic(self, topic: StoredTopic, offered: str) -> None:
        """Write a topic, with its publishers' QoS and the hash of its type."""
        self._database.execute(
            "INSERT INTO topics VALUES(?, ?, ?, 'cdr', ?, ?)",
            (topic.number, topic.name, topic.type, offered, topic.type_hash),
        )

    def write_many(self, number: int, messages: Messages) -> None:
        """Write messages into the open transaction."""
        self._database.executemany(
            "INSERT INTO messages (topic_id, timestamp, data) VALUES(?, ?, ?)",
            [(number, time_ns, data) for time_ns, data in messages],
        )
        self._bytes += sum(len(data) + ROW_BYTES for _, data in messages)

    def flush(self) -> None:
        """Commit."""
        self._database.commit()

    def size(self) -> int:
        """Return about the bytes of the messages: SQLite grows by pages, and by its journal."""
        return self._bytes

    def close(self, version: int, metadata: str) -> None:
        """Write the bag's metadata, fold the journal into the file, and close."""
        self._database.execute("INSERT INTO metadata VALUES(NULL, ?, ?)", (version, metadata))
        self._database.commit()
        self._database.execute("PRAGMA optimize")
        self._database.execute("PRAGMA journal_mode=DELETE")
        self._database.close()
