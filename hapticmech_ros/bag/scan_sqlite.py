# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Reads an SQLite storage file whose writer may have been killed, without touching the original."""

from __future__ import annotations

import io
import shutil
import sqlite3
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from tempfile import TemporaryDirectory

from rosbags.rosbag2 import ReaderError

from hapticmech_ros.bag.scan import Found
from hapticmech_ros.bag.tables import (
    HEAD,
    ROW,
    STEPS_AT_ONCE,
    Steps,
    checked_message,
    page_size,
    refuse_strange_tables,
    stored_topics,
)
from hapticmech_ros.files import check_file, exists

JOURNALS = ("-wal", "-journal")


class SqliteScan:
    """See :class:`hapticmech_ros.bag.scan.Scan`.

    Opening a database whose writer died changes it and its journal: a copy is opened.

    Args:
        path: of the file.
        scratch: folder for the copy.
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
            for suffix in JOURNALS:
                journal = self.path.with_name(self.path.name + suffix)
                if exists(journal):
                    size += check_file(journal)
                    shutil.copyfile(journal, copy.with_name(copy.name + suffix))
            read = 0
            try:
                with closing(sqlite3.connect(copy)) as database:
                    database.set_progress_handler(Steps(size).too_many, STEPS_AT_ONCE)
                    for found in _rows(database):
                        read += ROW + len(found.data) if found.data is not None else 0
                        if read > size:
                            raise ReaderError("it has more messages than there is room for in it")
                        yield found
            except (sqlite3.Error, ReaderError, UnicodeDecodeError) as error:
                self.trouble = f"cannot be read to its end ({error})"
                self.lost_bytes = max(0, size - read)


def _drop_cut_page(path: Path) -> None:
    """Take away a page that was cut: SQLite would read zeros where its messages' bytes are gone."""
    with path.open("r+b") as file:
        head = file.read(HEAD)
        size = file.seek(0, io.SEEK_END)
        page = page_size(head) if len(head) == HEAD else 0
        if page and size % page:
            file.truncate(size - size % page)


def _rows(database: sqlite3.Connection) -> Iterator[Found]:
    refuse_strange_tables(database.execute)
    topics = {number: topic for number, (topic, _) in stored_topics(database.execute).items()}
    for topic in topics.values():
        yield Found(topic)
    # In order of writing, not through the index, which may be what is damaged.
    query = "SELECT topic_id, timestamp, data FROM messages NOT INDEXED ORDER BY id"
    for row in database.execute(query):
        try:
            number, time_ns, data = checked_message(row)
        except ReaderError:
            continue
        if number in topics:
            yield Found(topics[number], time_ns, data)
