# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Reads rosbag2 files: what is in them, and their messages in order of time.

Topics that had another name in earlier versions are found by it.

A message's stamp is the sender's, read without decoding the message. Stamped are messages whose
first field is a header or a time, and the flat arrays of this package, whose label says ``stamp:2``
first: seconds and nanoseconds.
"""

from __future__ import annotations

import heapq
import os
import re
import struct
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Any, NamedTuple

from rosbags.interfaces import Connection, ConnectionExtRosbag2, Nodetype, Qos

from hapticmech_ros.bag.metadata import is_recording
from hapticmech_ros.bag.storage import COMPRESSED, SUFFIXES
from hapticmech_ros.bag.wanted import any_reader, number_of_files
from hapticmech_ros.errors import BagError
from hapticmech_ros.files import exists
from hapticmech_ros.times import NANOSECONDS

ARRAY = "std_msgs/msg/Float64MultiArray"
# Type of a first field that begins with a stamp.
_FIRST = ("std_msgs/msg/Header", "builtin_interfaces/msg/Time")
_LABEL = b"stamp:2,"
_HEADER = 4


def stamp_reader(msgtype: str, first_type: str) -> Callable[[bytes], int | None] | None:
    """Return what reads stamps (ns) from messages of a type, or None if it has none.

    The reader returns None for a message that is too short, or an array without a stamp.

    Args:
        msgtype: such as ``geometry_msgs/msg/PoseStamped``.
        first_type: message type of its first field; empty if that is a plain value.
    """
    if first_type in _FIRST:
        return _leading
    return _labelled if msgtype == ARRAY else None


def flat_fields(label: str) -> dict[str, int]:
    """Return names and sizes of a label ``name:size,name:size``; empty if it is another label."""
    found: dict[str, int] = {}
    for part in label.split(","):
        name, _, size = part.rpartition(":")
        if not name or not size.isdigit():
            return {}
        found[name] = int(size)
    return found


def _leading(message: bytes) -> int | None:
    try:
        seconds, nanoseconds = struct.unpack_from(f"{_order(message)}iI", message, _HEADER)
    except struct.error:
        return None
    return int(seconds) * NANOSECONDS + int(nanoseconds)


def _labelled(message: bytes) -> int | None:
    order = _order(message)
    try:
        dimensions, length = struct.unpack_from(f"{order}II", message, _HEADER)
        at = _HEADER + 8
        if dimensions != 1 or message[at : at + len(_LABEL)] != _LABEL:
            return None
        at += length
        # Size, stride and offset precede the length of the data, on multiples of four.
        at += -(at - _HEADER) % 4 + 12
        (count,) = struct.unpack_from(f"{order}I", message, at)
        at += 4
        at += -(at - _HEADER) % 8
        if count < 2:
            return None
        seconds, nanoseconds = struct.unpack_from(f"{order}dd", message, at)
        return int(seconds) * NANOSECONDS + int(nanoseconds)
    except (struct.error, ValueError, OverflowError):
        return None


def _order(message: bytes) -> str:
    return "<" if message[1:2] == b"\x01" else ">"


# Former name -> present name; a name of a point or link stands for itself.
FORMER = {
    "device/held_cf": "device/hand_cf/persistent",
    "device/servo_gain": "device/local_feedback_gain",
    r"mechanism/([^/]+)/held_cf": r"mechanism/\1/external_cf/persistent",
    r"mechanism/([^/]+)/grasp": r"mechanism/\1/set_operational_point",
    r"mechanism/([^/]+)/grasped": r"mechanism/\1/operational_point",
    r"analysis/([^/]+)/rendering": r"analysis/\1/operational_model",
}


def present_name(name: str) -> str:
    """Return the present name of a topic, its namespace kept; empty if it has not changed."""
    for former, present in FORMER.items():
        found = re.fullmatch(f"(.*/){former}(/[^/]+)?", name)
        if found:
            groups = [group or "" for group in found.groups()]
            return groups[0] + found.expand(present.replace(r"\1", r"\2")) + groups[-1]
    return ""


def refuse_former_topics(bag: BagReader) -> None:
    """Check that a bag holds no topic under a former name.

    Raises:
        BagError: it does; names each with its present name.
    """
    renamed = {name: present_name(name) for name in sorted(bag.topics)}
    listed = ", ".join(f"{name} is {now} now" for name, now in renamed.items() if now)
    if listed:
        rule = "was recorded before these topics were renamed"
        raise BagError(f"bag {bag.path}: {rule}: {listed}; docs/notation.md lists what has changed")


# How far messages of one file may be older than the last ones of the file before it.
OVERLAP_NS = 2_000_000_000
Raw = tuple[Connection, int, bytes]


@dataclass(frozen=True, slots=True)
class BagTopic:
    """A topic of a bag.

    Attributes:
        type: message type.
        count: number of messages.
        offered: what its publishers offered; empty if nobody wrote it down.
        type_hash: ``RIHS01_...``; empty if nobody wrote it down.
    """

    type: str
    count: int
    offered: tuple[Qos, ...] = ()
    type_hash: str = ""


class BagMessage(NamedTuple):
    """A message of a bag: topic, time of reception in ns, and the message itself."""

    topic: str
    time_ns: int
    message: Any


class MissingMessagesError(BagError):
    """A bag of which fewer messages can be read than it says it has."""


class BagReader:
    """An open bag: a rosbag2 folder, or a single ``.mcap`` or ``.db3`` file.

    Use it as a context manager.

    Raises:
        BagError: not there, not a bag, or not finished by its writer.
    """

    def __init__(self, path: str | os.PathLike[str]) -> None:
        self.path = Path(path)
        if not exists(self.path):
            raise BagError(f"no bag at {self.path}")
        if self.path.is_dir():
            self._check_folder()
        try:
            self._reader = any_reader(self.path)
            self._reader.open()
        except Exception as error:  # Decoders of three formats raise anything on damaged bytes.
            raise _damaged(self.path, error) from error
        self._files = number_of_files(self._reader)
        self._is_open = True
        self.topics: dict[str, BagTopic] = {
            name: _topic(info.msgtype, info.connections)
            for name, info in sorted(self._reader.topics.items())
        }

    @property
    def span_ns(self) -> tuple[int, int]:
        """Times of the first and the last message in the files, ns; zeros for an empty bag."""
        first, end = self._reader.start_time, self._reader.end_time
        if self._reader.message_count == 0 or end <= first:
            return 0, 0
        return first, end - 1

    def messages(self, *names: str) -> Iterator[BagMessage]:
        """Yield the messages of topics in order of reception, in one pass; of all if none given.

        Raises:
            BagError: topic not in the bag, or bytes that cannot be decoded.
        """
        for connection, time_ns, data in self._raw(names):
            try:
                message = self._reader.deserialize(data, connection.msgtype)
            except Exception as error:  # See __init__.
                raise _damaged(self.path, error, connection.topic) from error
            yield BagMessage(connection.topic, time_ns, message)

    def serialized(
        self, *names: str, start_ns: int | None = None, stop_ns: int | None = None
    ) -> Iterator[tuple[str, int, bytes]]:
        """Yield topic, time (ns) and CDR bytes of messages, otherwise as :meth:`messages`.

        Nothing is decoded.

        Args:
            names: of topics.
            start_ns: leave out what was received earlier.
            stop_ns: leave out what was received then or later.
        """
        for connection, time_ns, data in self._raw(names, start_ns, stop_ns):
            yield connection.topic, time_ns, bytes(data)

    def decode(self, name: str, data: bytes) -> Any:
        """Return the message of CDR bytes of a topic.

        Raises:
            BagError: topic not in the bag, or bytes that cannot be decoded.
        """
        if name not in self.topics:
            raise BagError(f"bag {self.path}: no topic {name}")
        try:
            return self._reader.deserialize(data, self.topics[name].type)
        except Exception as error:  # See __init__.
            raise _damaged(self.path, error, name) from error

    def stamps_of(self, name: str) -> Callable[[bytes], int | None] | None:
        """Return what reads a topic's stamps (ns) from its bytes; None for a type without stamps.

        Raises:
            BagError: topic not in the bag.
        """
        if name not in self.topics:
            raise BagError(f"bag {self.path}: no topic {name}")
        msgtype = self.topics[name].type
        _, fields = self._reader.typestore.fielddefs.get(msgtype, ((), ()))
        kind, detail = fields[0][1] if fields else (None, "")
        return stamp_reader(msgtype, str(detail) if kind == Nodetype.NAME else "")

    def _check_folder(self) -> None:
        stored = any(file.suffix in (*SUFFIXES, COMPRESSED) for file in self.path.iterdir())
        hint = f"; `hapticmech bag repair {self.path}` recovers what is there" if stored else ""
        if not (self.path / "metadata.yaml").is_file():
            rule = "not a bag, or its recording was cut short"
            raise BagError(f"bag {self.path} has no metadata.yaml: {rule}{hint}")
        if is_recording(self.path):
            rule = "it is still being recorded, or its recording was cut short"
            raise BagError(f"bag {self.path} is unfinished: {rule}{hint}")

    def _raw(
        self, names: tuple[str, ...], start_ns: int | None = None, stop_ns: int | None = None
    ) -> Iterator[Raw]:
        unknown = [name for name in names if name not in self.topics]
        if unknown:
            raise BagError(f"bag {self.path}: no topic {', '.join(unknown)}")
        chosen = [c for c in self._reader.connections if not names or c.topic in names]
        if not chosen:
            return
        stream = self._guarded(chosen, start_ns, stop_ns)
        read = dict.fromkeys((connection.topic for connection in chosen), 0)
        for item in stream if self._files == 1 else _in_order(stream):
            read[item[0].topic] += 1
            yield item
        if start_ns is None and stop_ns is None:
            self._refuse_less(read)

    def _refuse_less(self, read: Mapping[str, int]) -> None:
        """Refuse a bag of which fewer messages were read than it says it has.

        Raises:
            MissingMessagesError: with the topic, and how many of how many.
        """
        for name, count in read.items():
            stated = self.topics[name].count
            if count < stated:
                rule = f"{count} messages can be read, of {stated} stated"
                hint = f"`hapticmech bag repair {self.path}` recovers what can be read"
                raise MissingMessagesError(f"bag {self.path} (topic {name}): {rule}; {hint}")

    def _guarded(
        self, chosen: list[Connection], start_ns: int | None, stop_ns: int | None
    ) -> Iterator[Raw]:
        stream = self._reader.messages(connections=chosen, start=start_ns, stop=stop_ns)
        while True:
            try:
                item = next(stream, None)
            except Exception as error:  # See __init__.
                raise _damaged(self.path, error) from error
            if item is None:
                return
            yield item

    def close(self) -> None:
        """Close the bag; does nothing the second time."""
        if self._is_open:
            self._is_open = False
            self._reader.close()

    def __enter__(self) -> BagReader:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()


def read_topic(path: str | os.PathLike[str], name: str) -> Iterator[tuple[int, Any]]:
    """Yield (time of reception in ns, message) of one topic of the bag at ``path``.

    Raises:
        BagError: no such bag or topic, or damaged.
    """
    with BagReader(path) as bag:
        for item in bag.messages(name):
            yield item.time_ns, item.message


def _topic(msgtype: str | None, connections: list[Connection]) -> BagTopic:
    offered = (
        profile
        for connection in connections
        if isinstance(connection.ext, ConnectionExtRosbag2)
        for profile in connection.ext.offered_qos_profiles
    )
    return BagTopic(
        msgtype or "several types",
        sum(connection.msgcount for connection in connections),
        tuple(offered),
        next((connection.digest for connection in connections if connection.digest), ""),
    )


def _in_order(stream: Iterator[Raw]) -> Iterator[Raw]:
    """Put the messages around the end of a file in order: each file is ordered in itself only."""
    waiting: list[tuple[int, int, Raw]] = []
    newest = 0
    for number, item in enumerate(stream):
        heapq.heappush(waiting, (item[1], number, item))
        newest = max(newest, item[1])
        while waiting[0][0] < newest - OVERLAP_NS:
            yield heapq.heappop(waiting)[2]
    while waiting:
        yield heapq.heappop(waiting)[2]


def _damaged(path: Path, error: Exception, topic: str = "") -> BagError:
    where = f" (topic {topic})" if topic else ""
    reason = " ".join(str(error).split()) or type(error).__name__
    hint = "" if topic else f"; `hapticmech bag repair {path}` recovers what can be read"
    return BagError(f"bag {path}{where} is damaged, or its recording was cut short: {reason}{hint}")
