# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Reads the wanted topics of an mcap file at the cost of these topics.

The library takes every record of a chunk apart before it looks whether anybody wants it, which
takes most of its time where one topic of thirty is read. Here records are stepped over. What is
checked stays: size and checksum (if it has one) of each chunk, and that records end where it does.
"""

from __future__ import annotations

import heapq
import struct
from collections.abc import Collection, Generator, Mapping
from pathlib import Path
from typing import BinaryIO

from rosbags.interfaces import Connection, ConnectionExtRosbag2
from rosbags.rosbag2.errors import ReaderError
from rosbags.rosbag2.storage_mcap import ChunkInfo, McapReader, Statistics, read_exact

from hapticmech_ros.bag.metadata import read_offers
from hapticmech_ros.bag.scan_mcap import LATEST_NS, McapScan, channel_notes
from hapticmech_ros.bag.unpack import chunk_records
from hapticmech_ros.files import check_file

_HEAD = struct.Struct("<BQ")
_MESSAGE, _CHANNEL = 0x05, 0x04
# Footer and summary's offsets: what the index ends with.
_LAST = (0x02, 0x0E)
INDEX_RECORD_LIMIT = 16 << 20
# Channel, number, time of recording and of publishing; the message follows.
_MESSAGE_HEAD = struct.Struct("<HIQQ")
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
