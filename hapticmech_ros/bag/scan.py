# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What is left of a damaged storage file: every whole message, up to where the file breaks off.

What is compressed is unpacked to no more than it may become. 200 kB can unpack to many gigabytes.
What a file says of its own size is not believed.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple, Protocol
from zlib import crc32

from lz4.frame import LZ4FrameDecompressor
from rosbags.interfaces import MessageDefinition, MessageDefinitionFormat, Qos
from rosbags.rosbag2 import ReaderError

from hapticmech_ros.files import open_file

if sys.version_info >= (3, 14):
    from compression import zstd
else:
    from backports import zstd

# Bytes of a chunk, or a message, once it is unpacked.
UNPACKED_LIMIT = 256 << 20
# Bytes of a file that is compressed as a whole, for each of its own, above those of a chunk.
FILE_RATIO = 200
_BLOCK = 1 << 20
_KINDS = {"zstd": zstd.ZstdDecompressor, "lz4": LZ4FrameDecompressor}


def unpacked(data: bytes, compression: str, most: int = UNPACKED_LIMIT) -> bytes:
    """Return what bytes are once unpacked.

    Args:
        data: one or more frames.
        compression: ``zstd``, ``lz4``, or empty for none.
        most: bytes that it may become.

    Raises:
        ReaderError: damaged, unknown, or more than ``most``.
    """
    if not compression:
        return data
    if compression not in _KINDS:
        raise ReaderError(f"compression {compression!r} is not supported")
    parts: list[bytes] = []
    left = most
    while data:
        frame = _KINDS[compression]()
        try:
            parts.append(frame.decompress(data, max_length=left + 1))
        except (zstd.ZstdError, RuntimeError, ValueError) as error:
            raise ReaderError(f"compressed data are damaged ({error})") from None
        left -= len(parts[-1])
        if left < 0:
            raise ReaderError(f"compressed data become more than {most} bytes")
        if not frame.eof:
            raise ReaderError("compressed data break off")
        data = frame.unused_data or b""
    return b"".join(parts)


def chunk_records(data: bytes, compression: str, size: int, checksum: int) -> bytes:
    """Return the records of a chunk of mcap.

    Args:
        data: as it is in the file.
        compression: of the chunk.
        size: bytes that it says that it becomes.
        checksum: CRC-32 of the records; 0 for none.

    Raises:
        ReaderError: see :func:`unpacked`; or not of that size or checksum.
    """
    if size > UNPACKED_LIMIT:
        raise ReaderError(f"a chunk has at most {UNPACKED_LIMIT} bytes, not {size}")
    records = unpacked(data, compression, size)
    if len(records) != size:
        raise ReaderError(f"a chunk has {len(records)} bytes, not {size} as it says")
    if checksum and crc32(records) != checksum:
        raise ReaderError("a chunk's checksum does not match")
    return records


def unpack_file(file: Path, plain: Path) -> str:
    """Unpack a file as far as it goes; return why it ended early, or nothing.

    Raises:
        FileError: ``file`` is no regular file, or cannot be opened.
    """
    with open_file(file) as packed, plain.open("wb") as out:
        left = UNPACKED_LIMIT + FILE_RATIO * file.stat().st_size
        try:
            with zstd.open(packed, "rb") as stream:
                while block := stream.read(_BLOCK):
                    left -= len(block)
                    if left < 0:
                        return f"becomes more than {FILE_RATIO} times as large"
                    out.write(block)
        except (zstd.ZstdError, EOFError) as error:
            return f"breaks off within its compressed data ({error})"
    return ""


FORMATS = {
    "ros2msg": MessageDefinitionFormat.MSG,
    "ros2idl": MessageDefinitionFormat.IDL,
    "omgidl": MessageDefinitionFormat.IDL,
}
NO_DEFINITION = MessageDefinition(MessageDefinitionFormat.NONE, "")


@dataclass(frozen=True, slots=True)
class FoundTopic:
    """A topic as the file describes it; the type's hash may be empty."""

    name: str
    type: str
    definition: MessageDefinition
    type_hash: str
    offered: tuple[Qos, ...]


class Found(NamedTuple):
    """A topic, or with bytes a message of it, received at a time in ns."""

    topic: FoundTopic
    time_ns: int = 0
    data: bytes | None = None


class Scan(Protocol):
    """One pass over a file; what it met stands in its attributes afterwards.

    Attributes:
        path: the file.
        trouble: why the pass ended early, or what was passed over; empty for a whole file.
        lost_bytes: size of what could not be read; what it held is not known.
    """

    path: Path
    trouble: str
    lost_bytes: int

    def __iter__(self) -> Iterator[Found]:
        """Yield topics, each before its first message, and messages."""
        ...
