# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What is left of a damaged storage file: every whole message, up to where the file breaks off."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple, Protocol

from rosbags.interfaces import MessageDefinition, MessageDefinitionFormat, Qos

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
