# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The common part of a bag's storage files, mcap or SQLite: topics, messages, compression.

Unpacking is limited, as 200 kB can unpack to many gigabytes. Sizes, names and types that a file
states are not trusted.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

from lz4.frame import LZ4FrameDecompressor
from rosbags.interfaces import MessageDefinition, MessageDefinitionFormat, Qos

from hapticmech_ros.errors import HapticMechError
from hapticmech_ros.files import open_file

if sys.version_info >= (3, 14):
    from compression import zstd
else:
    from backports import zstd

# Bytes of a chunk, or a message, once it is unpacked.
UNPACKED_LIMIT = 256 << 20
# Bytes of a file that is compressed as a whole, for each of its own, above those of a chunk.
FILE_RATIO = 200
# Times are 64 bits with a sign, ns. rosbag2's starting time of a bag without messages is the
# latest.
LATEST_NS = 2**63 - 1
_BLOCK = 1 << 20
_KINDS = {"zstd": zstd.ZstdDecompressor, "lz4": LZ4FrameDecompressor}

SUFFIXES = {".mcap": "mcap", ".db3": "sqlite3"}
# Added to that of a file that was compressed as a whole.
COMPRESSED = ".zstd"
FORMATS = {
    "ros2msg": MessageDefinitionFormat.MSG,
    "ros2idl": MessageDefinitionFormat.IDL,
    "omgidl": MessageDefinitionFormat.IDL,
}
NO_DEFINITION = MessageDefinition(MessageDefinitionFormat.NONE, "")
# Times of reception, ns, and serialized messages.
Messages = Sequence[tuple[int, bytes | memoryview]]


class DamageError(HapticMechError):
    """A storage file, or a part of it, is damaged; readers of bags name it."""


@dataclass(frozen=True, slots=True)
class StoredTopic:
    """A topic as a storage file, or the metadata of a bag, describes it.

    Attributes:
        number: of the topic in its file.
        name: of the topic.
        type: of its messages.
        definition: of the type; its format is ``NONE`` where there is none.
        type_hash: ``RIHS01_...``; may be empty.
        offered: QoS of its publishers.
        count: of its messages, where known.
    """

    number: int
    name: str
    type: str
    definition: MessageDefinition = NO_DEFINITION
    type_hash: str = ""
    offered: tuple[Qos, ...] = ()
    count: int = 0

    @property
    def encoding(self) -> str:
        """The storages' name for the language of the definition."""
        return "ros2msg" if self.definition.format is MessageDefinitionFormat.MSG else "ros2idl"


class Found(NamedTuple):
    """A topic, or with bytes a message of it, received at a time in ns."""

    topic: StoredTopic
    time_ns: int = 0
    data: bytes | None = None


def unpacked(data: bytes, compression: str, most: int = UNPACKED_LIMIT) -> bytes:
    """Return unpacked bytes.

    Args:
        data: one or more frames.
        compression: ``zstd``, ``lz4``, or empty for none.
        most: bytes that it may become.

    Raises:
        DamageError: damaged, unknown, or more than ``most``.
    """
    if not compression:
        return data
    if compression not in _KINDS:
        raise DamageError(f"compression {compression!r} is not supported")
    parts: list[bytes] = []
    left = most
    while data:
        frame = _KINDS[compression]()
        try:
            parts.append(frame.decompress(data, max_length=left + 1))
        except (zstd.ZstdError, RuntimeError, ValueError) as error:
            raise DamageError(f"compressed data are damaged ({error})") from None
        left -= len(parts[-1])
        if left < 0:
            raise DamageError(f"compressed data become more than {most} bytes")
        if not frame.eof:
            raise DamageError("compressed data break off")
        data = frame.unused_data or b""
    return b"".join(parts)


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
