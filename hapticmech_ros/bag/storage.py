# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Storage files of a bag, one mcap or SQLite file each, that survive the death of their writer.

After :meth:`flush` all that was written is the operating system's, and a kill does not lose it.
"""

from __future__ import annotations

import sqlite3
import struct
from collections.abc import Sequence
from io import BytesIO
from pathlib import Path
from typing import Protocol

from rosbags.interfaces import Connection
from rosbags.rosbag2 import CompressionMode
from rosbags.rosbag2.storage_mcap import McapWriter, write_channel, write_string
from rosbags.rosbag2.storage_sqlite3 import Sqlite3Writer

# What SQLite needs for a message besides its bytes: row, index, unused parts of pages.
ROW_BYTES = 48
# Of an mcap file: a chunk is closed once it is longer.
LARGEST_CHUNK = 1 << 20
# A message in an mcap file (https://mcap.dev/spec#message-op0x05) up to its data: opcode, length
# of what follows, channel, sequence (none is known), times of log and of publication, ns.
_MCAP_MESSAGE = struct.Struct("<BQHIQQ")
_OPCODE, _AFTER_LENGTH = 0x05, _MCAP_MESSAGE.size - 9
# Times of reception, ns, and serialized messages.
Messages = Sequence[tuple[int, bytes | memoryview]]


class StorageFile(Protocol):
    """One file being written."""

    path: Path

    def __init__(self, folder: Path, stem: str) -> None:
        """Make ``folder/stem`` with the storage's suffix."""
        ...

    def add_msgtype(self, connection: Connection) -> None:
        """Write the definition of a connection's message type."""
        ...

    def add_connection(self, connection: Connection, offered_qos_profiles: str) -> None:
        """Write a topic."""
        ...

    def write_many(self, connection: Connection, messages: Messages) -> None:
        """Write messages of a topic."""
        ...

    def flush(self) -> None:
        """Hand everything to the operating system."""
        ...

    def size(self) -> int:
        """Return the bytes written so far, those not yet flushed included if known."""
        ...

    def close(self, version: int, metadata: str) -> None:
        """Write index and metadata, and close."""
        ...


class McapFile(McapWriter):
    """An mcap file: a chunk ends at 1 MiB, and at every flush."""

    def __init__(self, folder: Path, stem: str) -> None:
        own = _own_folder(folder, stem)
        super().__init__(own, CompressionMode.NONE)
        self.path = _moved_up(self.path)

    def add_connection(self, connection: Connection, offered_qos_profiles: str) -> None:
        """Write a topic; with the hash of its type, as rosbag2 does."""
        # The base class writes the channel at once, and without the hash: written again.
        start = self.chunk.bio.tell()
        super().add_connection(connection, offered_qos_profiles)
        extended = BytesIO()
        extended.write(self.channels[-1].metadata)
        write_string(extended, "topic_type_hash")
        write_string(extended, connection.digest)
        self.channels[-1] = self.channels[-1]._replace(metadata=extended.getvalue())
        self.chunk.bio.seek(start)
        self.chunk.bio.truncate()
        write_channel(self.chunk.bio, self.channels[-1], self.schemas)

    def write_many(self, connection: Connection, messages: Messages) -> None:
        """Write messages into the pending chunk, and that if it is large then."""
        chunk, stream = self.chunk, self.chunk.bio
        index = chunk.msgs[connection.id]
        head, offset = _MCAP_MESSAGE.pack, stream.tell()
        for time_ns, data in messages:
            index.append((time_ns, offset))
            size = _AFTER_LENGTH + len(data)
            offset += _MCAP_MESSAGE.size + len(data)
            stream.write(head(_OPCODE, size, connection.id, 0, time_ns, time_ns))
            stream.write(data)
        times = [time_ns for time_ns, _ in messages]
        first, last = min(times), max(times)
        self.message_start_time = min(first, self.message_start_time)
        self.message_end_time = max(last, self.message_end_time)
        chunk.message_start_time = min(first, chunk.message_start_time)
        chunk.message_end_time = max(last, chunk.message_end_time)
        self.channel_stats[connection.id] += len(messages)
        if offset > LARGEST_CHUNK:
            self.close_chunk()

    def close_chunk(self) -> None:
        """Write the pending chunk; one without messages has the times 0, as mcap asks."""
        if not self.chunk.msgs:
            self.chunk.message_start_time = self.chunk.message_end_time = 0
        super().close_chunk()

    def flush(self) -> None:
        """Write the pending chunk, if it holds messages, to the operating system."""
        if self.chunk.msgs:
            self.close_chunk()
        self.bio.flush()

    def size(self) -> int:
        """Return bytes so far, pending chunk included."""
        return int(self.bio.tell() + self.chunk.bio.tell())


class SqliteFile(Sqlite3Writer):
    """An SQLite file, for use by any thread, one at a time.

    Its journal is written ahead: a commit neither waits for the disk, nor does a kill undo it. A
    closed file has no journal beside it, as readers expect that open it as immutable.
    """

    def __init__(self, folder: Path, stem: str) -> None:
        own = _own_folder(folder, stem)
        super().__init__(own, CompressionMode.NONE)
        self.conn.close()
        self.path = _moved_up(self.path)
        self.conn = sqlite3.connect(self.path, check_same_thread=False)
        self.conn.execute("PRAGMA journal_mode=WAL")
        self.conn.execute("PRAGMA synchronous=OFF")
        self.cursor = self.conn.cursor()
        self._bytes = 0

    def write_many(self, connection: Connection, messages: Messages) -> None:
        """Write messages into the open transaction."""
        self.cursor.executemany(
            "INSERT INTO messages (topic_id, timestamp, data) VALUES(?, ?, ?)",
            [(connection.id, time_ns, data) for time_ns, data in messages],
        )
        self._bytes += sum(len(data) + ROW_BYTES for _, data in messages)

    def flush(self) -> None:
        """Commit."""
        self.conn.commit()

    def size(self) -> int:
        """Return about the bytes of the messages: SQLite grows by pages, and by its journal."""
        return self._bytes

    def close(self, version: int, metadata: str) -> None:
        """Write the metadata, fold the journal into the file, and close."""
        self.conn.commit()
        self.conn.execute("PRAGMA journal_mode=DELETE")
        super().close(version, metadata)


STORAGE_FILES: dict[str, type[StorageFile]] = {"mcap": McapFile, "sqlite3": SqliteFile}
SUFFIXES = {".mcap": "mcap", ".db3": "sqlite3"}
# Behind that of a file that was compressed as a whole.
COMPRESSED = ".zstd"


def _own_folder(folder: Path, stem: str) -> Path:
    """Return a new folder of that name: the base classes name their file after its folder."""
    own = folder / stem
    own.mkdir()
    return own


def _moved_up(path: Path) -> Path:
    moved = path.rename(path.parent.parent / path.name)
    path.parent.rmdir()
    return moved
