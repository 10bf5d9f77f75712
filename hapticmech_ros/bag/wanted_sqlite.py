"""Opens an SQLite file of a bag folder without counting its messages.

The library counts them by topic whenever it opens a file, which reads all of it; of a folder the
counts stand in ``metadata.yaml``, and are taken from there.
"""

from __future__ import annotations

import io
import struct

from rosbags.interfaces import (
    Connection,
    ConnectionExtRosbag2,
    MessageDefinition,
    MessageDefinitionFormat,
)
from rosbags.rosbag2.errors import ReaderError
from rosbags.rosbag2.metadata import ReaderMetadata, parse_qos
from rosbags.rosbag2.storage_sqlite3 import Sqlite3Reader

from hapticmech_ros.bag.scan import FORMATS, NO_DEFINITION

# Schema from which on the file has definitions of its message types and their hashes.
_WITH_DEFINITIONS = 4
_TABLES = {"schema", "messages", "topics", "message_definitions"}
# Of the first page: its head; places of the size of a page (1 is 65536), and number of pages.
_PAGE_SIZE, _PAGES = struct.Struct(">H"), struct.Struct(">I")
_PAGE_SIZE_AT, _PAGES_AT = 16, 28
_LARGEST_PAGE = 65536
_HEAD = 100


class WantedSqlite(Sqlite3Reader):
    """A file of a folder; as the library's reader, but for counts, which are 0.

    A file of an older schema is the library's.
    """

    def _open(self) -> None:
        self._refuse_cut()
        connection = self.dbconn
        if connection is None:
            raise ReaderError(f"{self.path} is not open")
        names = connection.execute('SELECT name FROM sqlite_master WHERE type = "table"')
        if not {str(row[0]) for row in names} >= _TABLES:
            super()._open()
            return
        version = connection.execute("SELECT schema_version FROM schema").fetchone()
        if version is None or int(version[0]) < _WITH_DEFINITIONS:
            super()._open()
            return
        self.schema = int(version[0])
        definitions = connection.execute(
            "SELECT topic_type, encoding, encoded_message_definition, type_description_hash"
            " FROM message_definitions ORDER BY id"
        )
        self.msgtypes = [
            dict(zip(("name", "encoding", "msgdef", "digest"), map(str, row), strict=True))
            for row in definitions
        ]
        topics = connection.execute(
            "SELECT id, name, type, serialization_format, offered_qos_profiles,"
            " type_description_hash FROM topics ORDER BY id"
        )
        self.connections = [
            Connection(
                number,
                name,
                kind,
                self._definition(kind),
                digest,
                0,
                ConnectionExtRosbag2(serialization, parse_qos(offered)),
                self,
            )
            for number, name, kind, serialization, offered, digest in topics
        ]
        first = connection.execute("SELECT MIN(timestamp) FROM messages").fetchone()
        last = connection.execute("SELECT MAX(timestamp) FROM messages").fetchone()
        if first is not None and last is not None and first[0] is not None:
            start, end = int(first[0]), int(last[0]) + 1
            self.metadata = ReaderMetadata(end - start, start, end, 0, None, None, None, None)

    def _definition(self, kind: str) -> MessageDefinition:
        found = next((one for one in self.msgtypes if one["name"] == kind), None)
        if found is None:
            return NO_DEFINITION
        return MessageDefinition(
            FORMATS.get(found["encoding"], MessageDefinitionFormat.NONE), found["msgdef"]
        )

    def _refuse_cut(self) -> None:
        """Refuse a file that is shorter than its first page says; counting would have found out."""
        with self.path.open("rb") as file:
            head = file.read(_HEAD)
            size = file.seek(0, io.SEEK_END)
        if len(head) < _HEAD:
            raise ReaderError(f"{self.path} is too short to be a database")
        page = _PAGE_SIZE.unpack_from(head, _PAGE_SIZE_AT)[0]
        pages = _PAGES.unpack_from(head, _PAGES_AT)[0]
        said = pages * (_LARGEST_PAGE if page == 1 else page)
        if said > size:
            raise ReaderError(f"{self.path} has {size} bytes of {said}")
