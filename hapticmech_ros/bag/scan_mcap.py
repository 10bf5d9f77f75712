# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Reads an mcap file front to back without its index, which a killed writer never wrote.

Records are: kind (1 byte), length (8 bytes), content. Messages are inside chunks, or loose; see
https://mcap.dev/spec.
"""

from __future__ import annotations

import io
import struct
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO

from rosbags.interfaces import MessageDefinition
from rosbags.rosbag2 import ReaderError

from hapticmech_ros.bag.metadata import read_offers
from hapticmech_ros.bag.scan import FORMATS, NO_DEFINITION, Found, FoundTopic
from hapticmech_ros.bag.unpack import UNPACKED_LIMIT, chunk_records
from hapticmech_ros.files import open_file

# Bytes of a record: a chunk that is not compressed, and its head.
RECORD_LIMIT = UNPACKED_LIMIT + 4096
# Times are 64 bits with a sign everywhere else.
LATEST_NS = 2**63 - 1
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
        with open_file(self.path) as file:
            size = file.seek(0, io.SEEK_END)
            file.seek(0)
            if file.read(len(MAGIC)) != MAGIC:
                self._lose("does not begin as an mcap file does", size)
                return
            while len(head := file.read(_HEAD.size)) == _HEAD.size:
                kind, length = _HEAD.unpack(head)
                there = size - file.tell()
                if length > there:
                    self._kept = 0
                    if kind == _CHUNK:
                        yield from self._cut_chunk(file.read(RECORD_LIMIT))
                    self._lose("breaks off within a record", len(head) + there - self._kept)
                    return
                if length > RECORD_LIMIT:
                    self._lose(f"has a record of more than {RECORD_LIMIT} bytes", length)
                    file.seek(length, io.SEEK_CUR)
                    continue
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
                if time_ns > LATEST_NS:
                    raise ReaderError(f"a message is of {time_ns} ns")
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
        yield from self._records(chunk_records(packed, compression, size, checksum))

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
            if kind == _CHUNK:
                self._lose("holds a chunk within a chunk", len(records) - self._kept)
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
        topic, _ = _text(content, 4)
        notes = channel_notes(content)
        if number in self._channels:
            return
        msgtype, definition = self._schemas[schema]
        offered = read_offers(notes.get("offered_qos_profiles", ""))
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


def channel_notes(content: bytes) -> dict[str, str]:
    """Return what a channel's record notes besides its topic.

    Raises:
        ReaderError: not such a record.
    """
    notes: dict[str, str] = {}
    try:
        _, at = _text(content, 4)
        _, at = _text(content, at)
        (length,) = struct.unpack_from("<I", content, at)
        at, end = at + 4, at + 4 + length
        while at < end:
            key, at = _text(content, at)
            notes[key], at = _text(content, at)
    except (struct.error, UnicodeDecodeError) as error:
        raise ReaderError(f"a channel cannot be read ({error})") from None
    return notes


def _text(content: bytes, at: int) -> tuple[str, int]:
    """Return the string at an offset, and the offset behind it."""
    (length,) = struct.unpack_from("<I", content, at)
    at += 4
    if at + length > len(content):
        raise ReaderError("a string is longer than its record")
    return content[at : at + length].decode(), at + length
