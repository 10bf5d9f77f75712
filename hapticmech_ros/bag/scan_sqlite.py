"""Reads an SQLite storage file whose writer may have been killed, without touching the original."""

from __future__ import annotations

import shutil
import sqlite3
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from tempfile import TemporaryDirectory

from rosbags.interfaces import MessageDefinition
from rosbags.rosbag2 import ReaderError
from rosbags.rosbag2.metadata import parse_qos

from hapticmech_ros.bag.scan import FORMATS, NO_DEFINITION, Found, FoundTopic

JOURNALS = ("-wal", "-journal")


class SqliteScan:
    """See :class:`hapticmech_ros.bag.scan.Scan`.

    Opening a database whose writer died changes it and its journal: a copy is opened.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.trouble = ""
        self.lost_bytes = 0

    def __iter__(self) -> Iterator[Found]:
        """Yield topics, each before its first message, and messages."""
        with TemporaryDirectory(dir=_roomy(self.path)) as folder:
            copy = Path(folder) / self.path.name
            shutil.copyfile(self.path, copy)
            for suffix in JOURNALS:
                journal = self.path.with_name(self.path.name + suffix)
                if journal.exists():
                    shutil.copyfile(journal, copy.with_name(copy.name + suffix))
            read = 0
            try:
                with closing(sqlite3.connect(copy)) as database:
                    for found in _rows(database):
                        read += len(found.data or b"")
                        yield found
            except (sqlite3.Error, ReaderError, UnicodeDecodeError) as error:
                self.trouble = f"cannot be read to its end ({error})"
                self.lost_bytes = max(0, self.path.stat().st_size - read)


def _rows(database: sqlite3.Connection) -> Iterator[Found]:
    topics = _topics(database)
    for topic in topics.values():
        yield Found(topic)
    # In order of writing, not through the index, which may be what is damaged.
    query = "SELECT topic_id, timestamp, data FROM messages NOT INDEXED ORDER BY id"
    for number, time_ns, data in database.execute(query):
        if number in topics and isinstance(data, bytes):
            yield Found(topics[number], time_ns, data)


def _topics(database: sqlite3.Connection) -> dict[int, FoundTopic]:
    have = {row[1] for row in database.execute("PRAGMA table_info(topics)")}
    optional = [
        name if name in have else f"'' AS {name}"
        for name in ("offered_qos_profiles", "type_description_hash")
    ]
    definitions = _definitions(database)
    found = {}
    query = f"SELECT id, name, type, {', '.join(optional)} FROM topics ORDER BY id"
    for number, name, msgtype, qos, type_hash in database.execute(query):
        definition = definitions.get(msgtype, NO_DEFINITION)
        found[number] = FoundTopic(name, msgtype, definition, type_hash, tuple(parse_qos(qos)))
    return found


def _definitions(database: sqlite3.Connection) -> dict[str, MessageDefinition]:
    if not list(database.execute("PRAGMA table_info(message_definitions)")):
        return {}
    query = "SELECT topic_type, encoding, encoded_message_definition FROM message_definitions"
    return {
        msgtype: MessageDefinition(FORMATS[encoding], text)
        for msgtype, encoding, text in database.execute(query)
        if encoding in FORMATS
    }


def _roomy(path: Path) -> Path | None:
    """Return a folder for a copy of a large file: beside the bag's folder, if we may write there.

    None stands for the system's folder for temporary files.
    """
    beside = path.resolve().parent.parent
    try:
        with TemporaryDirectory(dir=beside):
            return beside
    except OSError:
        return None
