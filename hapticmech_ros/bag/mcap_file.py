# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Reads and writes mcap files (https://mcap.dev/spec), by the records of the library ``mcap``.

A file is a row of records: kind (1 byte), length (8 bytes), content. Messages are inside chunks, or
loose. With an index the wanted topics are read at the cost of these alone: the library's reader
parses every record of a chunk, wanted or not, which takes most of the time where one topic of
thirty is read. Here unwanted records are skipped. These checks stay: size and checksum (if any) of
each chunk, and that its last record ends with it.

A killed writer has written no index: such a file is read front to back, as it is for repair.
"""

from __future__ import annotations

import heapq
import io
import struct
from collections import defaultdict
from collections.abc import Iterator, Set
from contextlib import suppress
from dataclasses import replace
from operator import itemgetter
from pathlib import Path
from typing import Any, BinaryIO, TypeVar, cast
from zlib import crc32

from mcap.data_stream import ReadDataStream, RecordBuilder
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import (
    Channel,
    Chunk,
    ChunkIndex,
    DataEnd,
    Footer,
    Header,
    McapRecord,
    Metadata,
    MetadataIndex,
    Schema,
    Statistics,
    SummaryOffset,
)
from rosbags.interfaces import MessageDefinition

from hapticmech_ros.bag.metadata import read_offers
from hapticmech_ros.bag.storage import (
    FORMATS,
    LATEST_NS,
    NO_DEFINITION,
    UNPACKED_LIMIT,
    DamageError,
    Found,
    Messages,
    StoredTopic,
    unpacked,
)
from hapticmech_ros.files import open_file

# Bytes of a record: a chunk that is not compressed, and its head.
RECORD_LIMIT = UNPACKED_LIMIT + 4096
MAGIC = b"\x89MCAP0\r\n"
_HEAD = struct.Struct("<BQ")
# Channel, sequence, times of log and of publication, ns; bytes of the message follow.
_MESSAGE_HEAD = struct.Struct("<HIQQ")
# Kind and length of a record, and the first number in it: of a message its channel.
_STEP = struct.Struct("<BQH")
# A message up to its bytes.
_MESSAGE_RECORD = struct.Struct("<BQHIQQ")
# Bytes of a footer's record, and of its content before the index's checksum.
_FOOTER, _TO_CHECKSUM = _HEAD.size + 20, 16
_OFFERS, _HASH = "offered_qos_profiles", "topic_type_hash"
# As members of an enumeration they are compared in more time than the rest of a step takes.
_MESSAGE, _CHUNK = int(Opcode.MESSAGE), int(Opcode.CHUNK)

Record = TypeVar("Record", bound=McapRecord)


class _Content(ReadDataStream):
    """The content of a record; for a value that is cut short the library would return the rest.

    Args:
        whole: whether that is damage.
    """

    def __init__(self, content: bytes, whole: bool) -> None:
        super().__init__(io.BytesIO(content))
        self._left, self._whole = len(content), whole

    def read(self, length: int) -> bytes:
        if length > self._left and self._whole:
            raise DamageError("a value is longer than its record")
        there = min(length, self._left)
        self._left -= there
        return super().read(there)


def _parsed(kind: type[Record], content: bytes, whole: bool = True) -> Record:
    """Return a record of the library's.

    Raises:
        DamageError: the content is no such record.
    """
    # Each has a function of that name, their common class has none.
    typed: Any = kind
    try:
        return cast(Record, typed.read(_Content(content, whole)))
    except (DamageError, McapError, UnicodeDecodeError, struct.error) as error:
        raise DamageError(f"a {kind.__name__.lower()} cannot be read ({error})") from None


def _framed(data: bytes) -> Iterator[tuple[int, int, int]]:
    """Yield kinds of records, and where their contents begin and end.

    Raises:
        DamageError: the last one is longer than the file's rest.
    """
    at, size = 0, len(data)
    while at < size:
        begin = at + _HEAD.size
        kind, length = _HEAD.unpack_from(data, at) if begin <= size else (0, 0)
        at = begin + length
        if at > size:
            raise DamageError("a record is longer than the chunk, or index, that it is in")
        yield kind, begin, at


def _chunk_records(content: bytes) -> bytes:
    """Return the records of a chunk, unpacked.

    Raises:
        DamageError: damaged, too large, or of another size or checksum than stated.
    """
    # Its size and checksum show whether it is complete.
    chunk = _parsed(Chunk, content, whole=False)
    size = chunk.uncompressed_size
    if size > UNPACKED_LIMIT:
        raise DamageError(f"a chunk has at most {UNPACKED_LIMIT} bytes, not {size}")
    records = unpacked(chunk.data, chunk.compression, size)
    if len(records) != size:
        raise DamageError(f"a chunk has {len(records)} bytes, not {size} as stated")
    if chunk.uncompressed_crc and crc32(records) != chunk.uncompressed_crc:
        raise DamageError("a chunk's checksum does not match")
    return records


class _Topics:
    """Topics of a file by the numbers of their channels, gathered from its records."""

    def __init__(self) -> None:
        self._types: dict[int, tuple[str, MessageDefinition]] = {0: ("", NO_DEFINITION)}
        self.found: dict[int, StoredTopic] = {}

    def add(self, kind: int, content: bytes) -> StoredTopic | None:
        """Take a record; return the topic that it adds, if any.

        Raises:
            DamageError: the record cannot be read.
            UnicodeDecodeError: a definition is no text.
            KeyError: a topic's type was not there before.
        """
        if kind == Opcode.SCHEMA:
            schema = _parsed(Schema, content)
            definition = NO_DEFINITION
            if schema.encoding in FORMATS:
                definition = MessageDefinition(FORMATS[schema.encoding], schema.data.decode())
            self._types[schema.id] = schema.name, definition
        elif kind == Opcode.CHANNEL:
            channel = _parsed(Channel, content)
            notes = channel.metadata
            offered = read_offers(notes.get(_OFFERS, ""))
            if channel.id not in self.found:
                kinds = self._types[channel.schema_id]
                topic = StoredTopic(
                    channel.id, channel.topic, *kinds, notes.get(_HASH, ""), offered
                )
                self.found[channel.id] = topic
                return topic
        return None


class McapScan:
    """One pass over a file, damaged or not; its attributes are the findings.

    Attributes:
        path: the file.
        trouble: why the pass ended early, or which parts were skipped; empty for a whole file.
        lost_bytes: size of unreadable parts, with unknown contents.
        topics: by number.
        chunks: how many there were.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.trouble = ""
        self.lost_bytes = 0
        self.chunks = 0
        self._topics = _Topics()
        self.topics = self._topics.found
        # Bytes of whole records in the chunk that was read last.
        self._kept = 0

    def __iter__(self) -> Iterator[Found]:
        """Yield topics, each before its first message, and messages."""
        with open_file(self.path) as file:
            size = file.seek(0, io.SEEK_END)
            file.seek(0)
            if file.read(len(MAGIC)) != MAGIC:
                self._lose("does not begin as an mcap file does", size)
                return
            checksum = crc32(MAGIC)
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
                content = file.read(length)
                if kind == Opcode.DATA_END:
                    self._look_at_end(file, size, content, checksum)
                    return
                checksum = crc32(content, crc32(head, checksum))
                yield from self._chunk(content) if kind == _CHUNK else self._record(kind, content)
            self._lose("breaks off before its index", len(head))

    def _record(self, kind: int, content: bytes) -> tuple[Found, ...]:
        """Return the message or new topic of a record that is no chunk; none if it is damaged."""
        try:
            if kind == _MESSAGE:
                number, _, time_ns, _ = _MESSAGE_HEAD.unpack_from(content)
                if time_ns > LATEST_NS:
                    raise DamageError(f"a message is of {time_ns} ns")
                return (Found(self.topics[number], time_ns, content[_MESSAGE_HEAD.size :]),)
            topic = self._topics.add(kind, content)
        except (struct.error, UnicodeDecodeError, KeyError, DamageError) as error:
            self._lose(f"holds a record that cannot be read ({error})", len(content))
            return ()
        return () if topic is None else (Found(topic),)

    def _chunk(self, content: bytes) -> Iterator[Found]:
        self.chunks += 1
        try:
            records = _chunk_records(content)
        except DamageError as error:
            self._lose(f"holds a record that cannot be read ({error})", len(content))
            return
        try:
            yield from self._records(records)
        except DamageError as error:
            self._lose(f"holds a chunk that cannot be read ({error})", len(records) - self._kept)

    def _cut_chunk(self, content: bytes) -> Iterator[Found]:
        """Yield the whole messages of a chunk that lacks its end; of a compressed one nothing."""
        with suppress(DamageError):
            chunk = _parsed(Chunk, content, whole=False)
            if not chunk.compression:
                yield from self._records(chunk.data)

    def _records(self, records: bytes) -> Iterator[Found]:
        self._kept = 0
        for kind, begin, end in _framed(records):
            if kind == _CHUNK:
                self._lose("holds a chunk within a chunk", len(records) - self._kept)
                return
            self._kept = end
            yield from self._record(kind, records[begin:end])

    def _look_at_end(self, file: BinaryIO, size: int, content: bytes, checksum: int) -> None:
        file.seek(max(0, size - len(MAGIC)))
        if file.read() != MAGIC:
            self._lose("has all its messages, but breaks off within its index", 0)
        said = int.from_bytes(content[:4], "little")
        if said and said != checksum and not self.lost_bytes:
            self._lose("has something changed in it: its checksum does not match", 0)

    def _lose(self, trouble: str, size: int) -> None:
        self.trouble = self.trouble or trouble
        self.lost_bytes += size


class McapReader:
    """A file open for reading.

    Attributes:
        path: the file.
        topics: in the order of the file.
        span: times of the first message and 1 ns behind the last one; (2⁶³ - 1, 0) without any.

    Raises:
        FileError: no regular file, or it cannot be opened.
        DamageError: damaged, or not of ROS 2.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._file = open_file(path)
        try:
            self._size = self._file.seek(0, io.SEEK_END)
            self._open()
        except BaseException:
            self._file.close()
            raise

    def _open(self) -> None:
        self._file.seek(0)
        if self._file.read(len(MAGIC)) != MAGIC:
            raise DamageError("it does not begin as an mcap file does")
        header = _parsed(Header, self._record_at(len(MAGIC), Opcode.HEADER))
        if header.profile != "ros2":
            raise DamageError(f"its profile is {header.profile!r}, not 'ros2'")
        begin, end = self._file.tell(), self._size - len(MAGIC) - _FOOTER
        content = self._record_at(max(0, end), Opcode.FOOTER)
        footer = _parsed(Footer, content)
        if self._file.read() != MAGIC:
            raise DamageError("it does not end as an mcap file does")
        index = b""
        if footer.summary_start:
            if not begin <= footer.summary_start <= end <= footer.summary_start + UNPACKED_LIMIT:
                raise DamageError(f"its index cannot be at {footer.summary_start}")
            self._file.seek(footer.summary_start)
            index = self._file.read(end - footer.summary_start)
            last = _HEAD.pack(Opcode.FOOTER, len(content)) + content[:_TO_CHECKSUM]
            if footer.summary_crc and footer.summary_crc != crc32(last, crc32(index)):
                raise DamageError("the checksum of its index does not match")
        self._read_index(index)

    def _read_index(self, index: bytes) -> None:
        """Take topics, counts and chunks from the index; writers may leave any part of it out."""
        known = _Topics()
        chunks: list[ChunkIndex] = []
        said: Statistics | None = None
        # A topic whose type is missing is missing itself.
        with suppress(KeyError):
            for kind, begin, end in _framed(index):
                if kind == Opcode.CHUNK_INDEX:
                    chunks.append(_parsed(ChunkIndex, index[begin:end]))
                elif kind == Opcode.STATISTICS:
                    said = _parsed(Statistics, index[begin:end])
                else:
                    known.add(kind, index[begin:end])
        topics = known.found
        if (
            said is not None
            and topics
            and said.channel_message_counts.keys() <= topics.keys()
            and sum(said.channel_message_counts.values()) == said.message_count
            and len(chunks) in (0, said.chunk_count)
        ):
            counts = said.channel_message_counts
            first, last = said.message_start_time, said.message_end_time
            if max(first, last) > LATEST_NS:
                raise DamageError(f"its messages are of {first} to {last} ns")
        else:
            scan = McapScan(self.path)
            counts = defaultdict(int)
            first, last = LATEST_NS, 0
            for topic, time_ns, data in scan:
                if data is not None:
                    counts[topic.number] += 1
                    first, last = min(first, time_ns), max(last, time_ns)
            if scan.trouble:
                raise DamageError(f"it {scan.trouble}")
            topics = scan.topics
            if len(chunks) != scan.chunks:
                chunks = []
        self._chunks = chunks
        self.span = (first, last + 1) if any(counts.values()) else (LATEST_NS, 0)
        self.topics = tuple(
            replace(topic, count=counts.get(number, 0)) for number, topic in topics.items()
        )

    def messages(self, wanted: Set[int], start: int, stop: int) -> Iterator[tuple[int, int, bytes]]:
        """Yield topics' numbers, times (ns) and bytes of messages, in order of time.

        Args:
            wanted: numbers of topics.
            start: leave out what was received earlier, ns.
            stop: leave out what was received then or later, ns.

        Raises:
            DamageError: the file is damaged, or has messages out of order and no index.
        """
        if not self._chunks:
            yield from self._without_index(wanted, start, stop)
            return
        chunks = [
            self._in_chunk(chunk, wanted, start, stop)
            for chunk in self._chunks
            if start <= chunk.message_end_time
            and chunk.message_start_time < stop
            # A chunk without indices of messages may have any.
            and not (chunk.message_index_offsets and wanted.isdisjoint(chunk.message_index_offsets))
        ]
        for time_ns, _, number, data in heapq.merge(*chunks):
            if number >= 0:
                yield number, time_ns, data

    def _in_chunk(
        self, chunk: ChunkIndex, wanted: Set[int], start: int, stop: int
    ) -> Iterator[tuple[int, int, int, bytes]]:
        """Yield time, place, topic's number and bytes of messages, in order of time.

        The first one, of no topic, stands for the chunk, which is read once its time comes.
        """
        place = chunk.chunk_start_offset
        yield chunk.message_start_time, place, -1, b""
        start = max(start, chunk.message_start_time)
        stop = min(stop, chunk.message_end_time + 1, LATEST_NS + 1)
        records = _chunk_records(self._record_at(place, Opcode.CHUNK))
        step, head, size = _STEP.unpack_from, _MESSAGE_RECORD.unpack_from, _MESSAGE_RECORD.size
        found: list[tuple[int, int, int, bytes]] = []
        at, last = 0, len(records) - _STEP.size
        while at <= last:
            kind, length, number = step(records, at)
            begin, at = at, at + _HEAD.size + length
            if kind == _MESSAGE and number in wanted:
                time_ns = head(records, begin)[4]
                if start <= time_ns < stop:
                    found.append((time_ns, place, number, records[begin + size : at]))
        if at != len(records):
            raise DamageError(f"records of the chunk at {place} do not end where it does")
        yield from sorted(found, key=itemgetter(0))

    def _without_index(
        self, wanted: Set[int], start: int, stop: int
    ) -> Iterator[tuple[int, int, bytes]]:
        scan, newest = McapScan(self.path), 0
        for topic, time_ns, data in scan:
            if data is not None and topic.number in wanted and start <= time_ns < stop:
                if time_ns < newest:
                    raise DamageError("its messages are not in order of time, and it has no index")
                newest = time_ns
                yield topic.number, time_ns, data
        if scan.trouble:
            raise DamageError(f"it {scan.trouble}")

    def _record_at(self, place: int, kind: Opcode) -> bytes:
        """Return the content of the record at a place.

        Raises:
            DamageError: there is no record of that kind.
        """
        begin = place + _HEAD.size
        if begin <= self._size:
            self._file.seek(place)
            found, length = _HEAD.unpack(self._file.read(_HEAD.size))
            if found == kind and length <= min(self._size - begin, RECORD_LIMIT):
                return self._file.read(length)
        raise DamageError(f"it has no {kind.name.lower()} at {place}")

    def close(self) -> None:
        """Close the file."""
        self._file.close()


# Of a file being written: a chunk is closed once it is longer, bytes.
LARGEST_CHUNK = 1 << 20


class McapFile:
    """A file being written, ``folder/stem.mcap``, that survives the death of its writer.

    A chunk ends at 1 MiB, and at a flush; then it is the operating system's, and a kill does not
    lose it.
    """

    def __init__(self, folder: Path, stem: str) -> None:
        self.path = folder / f"{stem}.mcap"
        self._file = self.path.open("xb")
        self._types: dict[str, Schema] = {}
        self._topics: list[Channel] = []
        self._chunks: list[ChunkIndex] = []
        self._counts: dict[int, int] = {}
        self._file.write(MAGIC)
        self._put(Header("ros2", "hapticmech_ros"))
        self._begin_chunk()

    def _begin_chunk(self) -> None:
        self._chunk = io.BytesIO()
        # By topic the time and place of its messages, one after the other.
        self._messages: dict[int, list[int]] = defaultdict(list)

    def _put(self, record: McapRecord, stream: BinaryIO | None = None) -> None:
        builder = RecordBuilder()
        record.write(builder)
        (stream or self._file).write(builder.end())  # type: ignore[no-untyped-call]

    def add_type(self, topic: StoredTopic) -> None:
        """Write the definition of a topic's message type."""
        data, number = topic.definition.data.encode(), len(self._types) + 1
        self._types[topic.type] = Schema(number, data, topic.encoding, topic.type)
        self._put(self._types[topic.type], self._chunk)

    def add_topic(self, topic: StoredTopic, offered: str) -> None:
        """Write a topic, with its publishers' QoS and the hash of its type."""
        notes = {_OFFERS: offered, _HASH: topic.type_hash}
        schema = self._types[topic.type].id
        self._topics.append(Channel(topic.number, topic.name, "cdr", notes, schema))
        self._counts[topic.number] = 0
        self._put(self._topics[-1], self._chunk)

    def write_many(self, number: int, messages: Messages) -> None:
        """Write messages into the pending chunk, and that if it is large then."""
        index, pack, at = self._messages[number], _MESSAGE_RECORD.pack, self._chunk.tell()
        records: list[bytes | memoryview] = []
        for time_ns, data in messages:
            index += (time_ns, at)
            size = _MESSAGE_HEAD.size + len(data)
            at += _HEAD.size + size
            # No sequence is known, and no time of publication.
            records += (pack(_MESSAGE, size, number, 0, time_ns, time_ns), data)
        self._chunk.write(b"".join(records))
        self._counts[number] += len(messages)
        if at > LARGEST_CHUNK:
            self._close_chunk()

    def _close_chunk(self) -> None:
        times = [time_ns for found in self._messages.values() for time_ns in found[::2]]
        # Without messages they are 0, as mcap asks.
        span = min(times, default=0), max(times, default=0)
        data = self._chunk.getvalue()
        place = self._file.tell()
        self._put(Chunk("", data, span[1], span[0], 0, len(data)))
        end = self._file.tell()
        places = {}
        for number, found in self._messages.items():
            places[number] = self._file.tell()
            # As the library's MessageIndex, which takes as long as all the rest.
            content = struct.pack(f"<HI{len(found)}Q", number, 8 * len(found), *found)
            self._file.write(_HEAD.pack(Opcode.MESSAGE_INDEX, len(content)) + content)
        self._chunks.append(
            ChunkIndex(
                chunk_length=end - place,
                chunk_start_offset=place,
                compression="",
                compressed_size=len(data),
                message_end_time=span[1],
                message_index_length=self._file.tell() - end,
                message_index_offsets=places,
                message_start_time=span[0],
                uncompressed_size=len(data),
            )
        )
        self._begin_chunk()

    def flush(self) -> None:
        """Write the pending chunk, if it holds messages, to the operating system."""
        if self._messages:
            self._close_chunk()
        self._file.flush()

    def size(self) -> int:
        """Return bytes so far, pending chunk included."""
        return self._file.tell() + self._chunk.tell()

    def close(self, version: int, metadata: str) -> None:
        """Write the index, with the bag's metadata, and close."""
        if self._chunk.tell():
            self._close_chunk()
        notes, place = Metadata("rosbag2", {"serialized_metadata": metadata}), self._file.tell()
        self._put(notes)
        notes_index = MetadataIndex(place, self._file.tell() - place, notes.name)
        self._put(DataEnd(0))
        chunks = [chunk for chunk in self._chunks if chunk.message_index_offsets]
        statistics = Statistics(
            attachment_count=0,
            channel_count=len(self._topics),
            channel_message_counts=self._counts,
            chunk_count=len(self._chunks),
            message_count=sum(self._counts.values()),
            message_end_time=max((chunk.message_end_time for chunk in chunks), default=0),
            message_start_time=min((c.message_start_time for c in chunks), default=LATEST_NS),
            metadata_count=1,
            schema_count=len(self._types),
        )
        start, groups = self._file.tell(), []
        for kind, records in (
            (Opcode.SCHEMA, self._types.values()),
            (Opcode.CHANNEL, self._topics),
            (Opcode.CHUNK_INDEX, self._chunks),
            (Opcode.METADATA_INDEX, [notes_index]),
            (Opcode.STATISTICS, [statistics]),
        ):
            place = self._file.tell()
            for record in records:
                self._put(record)
            if self._file.tell() > place:
                groups.append(SummaryOffset(kind, place, self._file.tell() - place))
        offsets = self._file.tell()
        for group in groups:
            self._put(group)
        self._put(Footer(start, offsets, 0))
        self._file.write(MAGIC)
        self._file.close()
