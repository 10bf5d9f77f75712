"""Reads an mcap file front to back without its index, which a killed writer never wrote.

Records are: kind (1 byte), length (8 bytes), content. Messages are inside chunks, or loose; see
https://mcap.dev/spec.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO

from rosbags.interfaces import MessageDefinition
from rosbags.rosbag2 import ReaderError
from rosbags.rosbag2.metadata import parse_qos
from rosbags.rosbag2.storage_mcap import decompress

from hapticmech_ros.bag.scan import FORMATS, NO_DEFINITION, Found, FoundTopic

MAGIC = b"\x89MCAP0\r\n"
_SCHEMA, _CHANNEL, _MESSAGE, _CHUNK, _DATA_END = 0x03, 0x04, 0x05, 0x06, 0x0F
_HEAD = struct.Struct("<BQ")
_MESSAGE_HEAD = struct.Struct("<HIQQ")
_CHUNK_HEAD = struct.Struct("<QQQI")
_BROKEN = (struct.error, UnicodeDecodeError, KeyError, TypeError, ReaderError)


class McapScan:
    """See :class:`hapticmech_ros.bag.scan.Scan`."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.trouble = ""
        self.lost_bytes = 0
        # Bytes of whole records in the chunk that was read last.
        self._kept = 0
        self._schemas: dict[int, tuple[str, MessageDefinition]] = {}
        self._channels: dict[int, FoundTopic] = {}

    def __iter__(self) -> Iterator[Found]:
        """Yield topics, each before its first message, and messages."""
        size = self.path.stat().st_size
        with self.path.open("rb") as file:
            if file.read(len(MAGIC)) != MAGIC:
                self._lose("does not begin as an mcap file does", size)
                return
            while len(head := file.read(_HEAD.size)) == _HEAD.size:
                kind, length = _HEAD.unpack(head)
                if length > size - file.tell():
                    left = file.read()
                    if kind == _CHUNK:
                        yield from self._cut_chunk(left)
                    self._lose("breaks off within a record", len(head) + len(left) - self._kept)
                    return
                if kind == _DATA_END:
                    self._look_at_end(file, size)
                    return
                yield from self._record(kind, file.read(length))
            self._lose("breaks off before its index", len(head))

    def _record(self, kind: int, content: bytes) -> Iterator[Found]:
        try:
            if kind == _CHUNK:
                yield from self._chunk(content)
            elif kind == _MESSAGE:
                channel, _, time_ns, _ = _MESSAGE_HEAD.unpack_from(content)
                yield Found(self._channels[channel], time_ns, content[_MESSAGE_HEAD.size :])
            elif kind == _SCHEMA:
                self._schema(content)
            elif kind == _CHANNEL:
                yield from self._channel(content)
        except _BROKEN as error:
            reason = str(error) or type(error).__name__
            self._lose(f"holds a record that cannot be read ({reason})", len(content))

    def _chunk(self, content: bytes) -> Iterator[Found]:
        _, _, size, checksum = _CHUNK_HEAD.unpack_from(content)
        compression, at = _text(content, _CHUNK_HEAD.size)
        (length,) = struct.unpack_from("<Q", content, at)
        packed = content[at + 8 : at + 8 + length]
        try:
            records = decompress(packed, compression, size, checksum)
        except Exception as error:  # Decompressors have errors of their own.
            raise ReaderError(f"chunk: {error}") from error
        yield from self._records(records)

    def _cut_chunk(self, content: bytes) -> Iterator[Found]:
        """Yield the whole messages of a chunk that lacks its end; of a compressed one nothing."""
        try:
            compression, at = _text(content, _CHUNK_HEAD.size)
        except _BROKEN:
            return
        if not compression:
            yield from self._records(content[at + 8 :])

    def _records(self, records: bytes) -> Iterator[Found]:
        self._kept = 0
        while (at := self._kept + _HEAD.size) <= len(records):
            kind, length = _HEAD.unpack_from(records, self._kept)
            if at + length > len(records):
                return
            self._kept = at + length
            yield from self._record(kind, records[at : self._kept])

    def _schema(self, content: bytes) -> None:
        (number,) = struct.unpack_from("<H", content)
        name, at = _text(content, 2)
        encoding, at = _text(content, at)
        text, _ = _text(content, at)
        known = encoding in FORMATS
        definition = MessageDefinition(FORMATS[encoding], text) if known else NO_DEFINITION
        self._schemas[number] = (name, definition)

    def _channel(self, content: bytes) -> Iterator[Found]:
        number, schema = struct.unpack_from("<HH", content)
        topic, at = _text(content, 4)
        _, at = _text(content, at)
        (length,) = struct.unpack_from("<I", content, at)
        at, end = at + 4, at + 4 + length
        notes: dict[str, str] = {}
        while at < end:
            key, at = _text(content, at)
            notes[key], at = _text(content, at)
        if number in self._channels:
            return
        msgtype, definition = self._schemas[schema]
        offered = tuple(parse_qos(notes.get("offered_qos_profiles", "")))
        type_hash = notes.get("topic_type_hash", "")
        self._channels[number] = FoundTopic(topic, msgtype, definition, type_hash, offered)
        yield Found(self._channels[number])

    def _look_at_end(self, file: BinaryIO, size: int) -> None:
        file.seek(max(0, size - len(MAGIC)))
        if file.read() != MAGIC:
            self._lose("has all its messages, but breaks off within its index", 0)

    def _lose(self, trouble: str, size: int) -> None:
        self.trouble = self.trouble or trouble
        self.lost_bytes += size


def _text(content: bytes, at: int) -> tuple[str, int]:
    """Return the string at an offset, and the offset behind it."""
    (length,) = struct.unpack_from("<I", content, at)
    at += 4
    if at + length > len(content):
        raise ReaderError("a string is longer than its record")
    return content[at : at + length].decode(), at + length
