# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Reads an mcap file front to back without its index, which a killed writer never wrote.

Records are: kind (1 byte), length (8 bytes), content. Messages are inside chunks, or loose; see
https://mcap.dev/spec.

With an index the wanted topics are read at the cost of these alone. The library takes every record
of a chunk apart before it looks whether anybody wants it, which takes most of its time where one
topic of thirty is read. Here records are stepped over. What is checked stays: size and checksum (if
it has one) of each chunk, and that records end where it does.
"""

from __future__ import annotations

import heapq
import io
import struct
from collections.abc import Collection, Generator, Iterator, Mapping
from pathlib import Path
from typing import BinaryIO

from rosbags.interfaces import Connection, ConnectionExtRosbag2, MessageDefinition
from rosbags.rosbag2.errors import ReaderError
from rosbags.rosbag2.storage_mcap import ChunkInfo, McapReader, Statistics, read_exact

from hapticmech_ros.bag.metadata import read_offers
from hapticmech_ros.bag.scan import (
    FORMATS,
    NO_DEFINITION,
    UNPACKED_LIMIT,
    Found,
    FoundTopic,
    chunk_records,
)
from hapticmech_ros.files import check_file, open_file

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


# Footer and summary's offsets: what the index ends with.
_LAST = (0x02, 0x0E)
INDEX_RECORD_LIMIT = 16 << 20
_CHECKSUM = struct.Struct("<I")
# Of a chunk's record: head, times and size before the checksum; all that comes before the name of
# the compression.
_TO_CHECKSUM, _TO_NAME = 9 + 24, 9 + 40

# Time, place of the chunk, connection (None before the first one), bytes.
_Item = tuple[int, int, Connection | None, bytes]


class WantedMcap(McapReader):
    """An mcap file; as the library's reader, and faster where few topics are wanted.

    A file without an index is read front to back, as it is for repair.
    """

    def open(self) -> None:
        """Open the file."""
        check_file(str(self.path))
        super().open()

    def read_index(self) -> None:
        """Read topics and chunks from the file's end, once topics were found to be plain ones.

        Raises:
            ReaderError: the index is damaged.
        """
        bio = self.bio
        if bio is None:
            raise ReaderError(f"{self.path} is not open")
        bio.seek(self.data_end)
        while len(head := bio.read(_HEAD.size)) == _HEAD.size:
            kind, length = _HEAD.unpack(head)
            if kind in _LAST:
                break
            if length > INDEX_RECORD_LIMIT:
                raise ReaderError(f"its index has a record of more than {INDEX_RECORD_LIMIT} bytes")
            content = read_exact(bio, length)
            if kind == _CHANNEL:
                read_offers(channel_notes(content).get("offered_qos_profiles", ""))
        super().read_index()
        found = self.statistics
        if found is not None and max(found.start_time, found.end_time) > LATEST_NS:
            raise ReaderError(f"its messages are of {found.start_time} to {found.end_time} ns")
        if not self._is_complete():
            self.statistics = None
            self.chunks.clear()

    def _is_complete(self) -> bool:
        """Whether the index has all topics and counts; writers may leave any part of it out."""
        known = {connection.id for connection in self.connections}
        found = self.statistics
        if not known or not self.schemas:
            return False
        if found is None:
            return all(chunk.channel_count for chunk in self.chunks)
        chunks = len(self.chunks)
        return set(found.channel_message_counts) <= known and chunks in (0, found.chunk_count)

    def meta_scan(self) -> None:
        """Find topics, and count messages, by reading all.

        Raises:
            ReaderError: the file is damaged.
        """
        scan = McapScan(Path(str(self.path)))
        counts: dict[int, int] = {}
        numbers: dict[str, int] = {}
        first, last = LATEST_NS, 0
        self.connections.clear()
        for topic, time_ns, data in scan:
            number = numbers.setdefault(topic.name, len(numbers) + 1)
            if data is None and number not in counts:
                extra = ConnectionExtRosbag2("cdr", list(topic.offered))
                self.connections.append(
                    Connection(number, topic.name, topic.type, topic.definition, "", 0, extra, self)
                )
                counts[number] = 0
            elif data is not None:
                counts[number] += 1
                first, last = min(first, time_ns), max(last, time_ns)
        if scan.trouble:
            raise ReaderError(f"it {scan.trouble}")
        total = sum(counts.values())
        self.statistics = Statistics(total, 0, len(counts), 0, 0, 0, first, last, counts)

    def messages_scan(
        self,
        connections: Collection[Connection],
        start: int | None = None,
        stop: int | None = None,
    ) -> Generator[tuple[Connection, int, bytes], None, None]:
        """Yield messages of a file without an index, as they are written."""
        wanted = {connection.topic: connection for connection in connections}
        for topic, time_ns, data in McapScan(Path(str(self.path))):
            in_time = (start is None or start <= time_ns) and (stop is None or time_ns < stop)
            if data is not None and in_time and topic.name in wanted:
                yield wanted[topic.name], time_ns, data

    def messages(
        self,
        connections: Collection[Connection],
        start: int | None = None,
        stop: int | None = None,
    ) -> Generator[tuple[Connection, int, bytes], None, None]:
        """Yield connection, time (ns) and bytes of messages, in order of time."""
        if not self.chunks or self.bio is None:
            yield from super().messages(connections, start, stop)
            return
        wanted = {connection.id: connection for connection in connections}
        chunks = (
            _messages(
                self.bio,
                chunk,
                wanted,
                chunk.message_start_time if start is None else start,
                chunk.message_end_time + 1 if stop is None else stop,
            )
            for chunk in self.chunks
            if (start is None or start < chunk.message_end_time + 1)
            and (stop is None or chunk.message_start_time < stop)
            # A chunk without indices of messages may have any.
            and (
                not chunk.channel_count
                or any(chunk.channel_count.get(channel, 0) for channel in wanted)
            )
        )
        for time_ns, _, connection, data in heapq.merge(*chunks):
            if connection is not None:
                yield connection, time_ns, data


def _messages(
    bio: BinaryIO, chunk: ChunkInfo, wanted: Mapping[int, Connection], start: int, stop: int
) -> Generator[_Item, None, None]:
    """Yield the wanted messages of a chunk; it is read once its first time comes."""
    yield chunk.message_start_time, 0, None, b""
    place = chunk.chunk_start_offset
    bio.seek(place + _TO_CHECKSUM)
    (checksum,) = _CHECKSUM.unpack(read_exact(bio, _CHECKSUM.size))
    bio.seek(place + _TO_NAME + len(chunk.compression))
    packed = read_exact(bio, chunk.compressed_size)
    records = chunk_records(packed, chunk.compression, chunk.uncompressed_size, checksum)
    found: list[_Item] = []
    at, size = 0, len(records)
    while at < size:
        kind, length = _HEAD.unpack_from(records, at)
        at += _HEAD.size
        end = at + length
        if end > size:
            raise ReaderError(f"a record of the chunk at {place} is longer than the chunk")
        if kind == _MESSAGE:
            channel, _, time_ns, _ = _MESSAGE_HEAD.unpack_from(records, at)
            if time_ns > LATEST_NS:
                raise ReaderError(f"a message of the chunk at {place} is of {time_ns} ns")
            if channel in wanted and start <= time_ns < stop:
                found.append(
                    (time_ns, place, wanted[channel], records[at + _MESSAGE_HEAD.size : end])
                )
        at = end
    yield from sorted(found, key=_time)


def _time(item: _Item) -> int:
    return item[0]
