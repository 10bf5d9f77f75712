# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Reads rosbag2 files: their topics, and their messages in order of time.

Topics that had another name in earlier versions are found by it.

A message's stamp is the sender's, read without decoding the message. Stamped are messages whose
first field is a header or a time, and the flat arrays of this package, whose label begins with
``stamp:2``: seconds and nanoseconds.
"""

from __future__ import annotations

import heapq
import os
import re
import struct
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import AbstractContextManager, ExitStack
from dataclasses import dataclass, replace
from pathlib import Path, PurePosixPath
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

from rosbags.interfaces import MessageDefinitionFormat, Nodetype, Qos
from rosbags.typesys import Stores, get_types_from_idl, get_types_from_msg, get_typestore

from hapticmech_ros.bag.mcap_file import McapReader
from hapticmech_ros.bag.metadata import is_unfinished, load_metadata, read_metadata, topics_of
from hapticmech_ros.bag.sqlite_file import SqliteReader
from hapticmech_ros.bag.storage import (
    COMPRESSED,
    LATEST_NS,
    NO_DEFINITION,
    SUFFIXES,
    DamageError,
    StoredTopic,
    unpack_file,
    unpacked,
)
from hapticmech_ros.errors import BagError, listed
from hapticmech_ros.files import exists
from hapticmech_ros.numerics.times import NANOSECONDS

ARRAY = "std_msgs/msg/Float64MultiArray"
# Type of a first field that begins with a stamp.
_FIRST = ("std_msgs/msg/Header", "builtin_interfaces/msg/Time")
_LABEL = b"stamp:2,"
_HEADER = 4


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


# Former name -> present name; names of points and links are unchanged.
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
# Of the definitions of all topics, which the library parses at some 30 us a line.
DEFINITIONS_SIZE, DEFINITIONS_LINES = 4_000_000, 200_000
# Separator before each part of a definition in IDL, where there are several.
_IDL = "=" * 80 + "\nIDL: "
StorageReader = McapReader | SqliteReader
_READERS: dict[str, type[StorageReader]] = {"mcap": McapReader, "sqlite3": SqliteReader}
Raw = tuple[StoredTopic, int, bytes]


@dataclass(frozen=True, slots=True)
class BagTopic:
    """A topic of a bag.

    Attributes:
        type: message type.
        count: number of messages.
        offered: QoS of its publishers; empty if not recorded.
        type_hash: ``RIHS01_...``; empty if not recorded.
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
    """A bag has fewer readable messages than stated."""


class BagReader(AbstractContextManager["BagReader"]):
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
        self._stack = ExitStack()
        self._files: list[StorageReader] = []
        self._is_packed = False
        try:
            self._stored = tuple(self._open_folder() if self.path.is_dir() else self._open_file())
            self._types = _typestore(self._stored)
        except Exception as error:  # Decoders of three formats raise anything on damaged bytes.
            self._stack.close()
            raise _damaged(self.path, error) from error
        self.topics = topics_by_name(self._stored)

    @property
    def span_ns(self) -> tuple[int, int]:
        """Times of the first and the last message in the files, ns; zeros for an empty bag."""
        first = min((file.span[0] for file in self._files), default=LATEST_NS)
        end = max((file.span[1] for file in self._files), default=0)
        return (first, end - 1) if end > first else (0, 0)

    def messages(self, *names: str) -> Iterator[BagMessage]:
        """Yield the messages of topics in order of reception, in one pass; of all if none given.

        Raises:
            BagError: topic not in the bag, or bytes that cannot be decoded.
        """
        for topic, time_ns, data in self._raw(names):
            try:
                message = self._types.deserialize_cdr(data, topic.type)
            except Exception as error:  # See __init__.
                raise _damaged(self.path, error, topic.name) from error
            yield BagMessage(topic.name, time_ns, message)

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
        for topic, time_ns, data in self._raw(names, start_ns, stop_ns):
            yield topic.name, time_ns, data

    def decode(self, name: str, data: bytes) -> Any:
        """Return the message of CDR bytes of a topic.

        Raises:
            BagError: topic not in the bag, or bytes that cannot be decoded.
        """
        if name not in self.topics:
            raise BagError(f"bag {self.path}: no topic {name}")
        try:
            return self._types.deserialize_cdr(data, self.topics[name].type)
        except Exception as error:  # See __init__.
            raise _damaged(self.path, error, name) from error

    def stamps_of(self, name: str) -> Callable[[bytes], int | None] | None:
        """Return a reader of a topic's stamps (ns) from bytes; None for a type without stamps.

        The reader returns None for a message that is too short, or an array without a stamp.

        Raises:
            BagError: topic not in the bag.
        """
        if name not in self.topics:
            raise BagError(f"bag {self.path}: no topic {name}")
        msgtype = self.topics[name].type
        _, fields = self._types.fielddefs.get(msgtype, ((), ()))
        kind, detail = fields[0][1] if fields else (None, "")
        if kind == Nodetype.NAME and str(detail) in _FIRST:
            return _leading
        return _labelled if msgtype == ARRAY else None

    def _check_folder(self) -> None:
        stored = any(file.suffix in (*SUFFIXES, COMPRESSED) for file in self.path.iterdir())
        hint = f"; `hapticmech bag repair {self.path}` recovers what is there" if stored else ""
        if not (self.path / "metadata.yaml").is_file():
            rule = "not a bag, or its recording was cut short"
            raise BagError(f"bag {self.path} has no metadata.yaml: {rule}{hint}")
        if is_unfinished(read_metadata(self.path)):
            rule = "it is still being recorded, or its recording was cut short"
            raise BagError(f"bag {self.path} is unfinished: {rule}{hint}")

    def _open_file(self) -> Iterable[StoredTopic]:
        if self.path.suffix not in SUFFIXES:
            raise DamageError(f"files of bags are {' or '.join(SUFFIXES)}")
        file = self._opened(SUFFIXES[self.path.suffix], self.path)
        if isinstance(file, SqliteReader):
            file.count()
        return file.topics

    def _open_folder(self) -> Iterable[StoredTopic]:
        """Open all files that the metadata name, from which counts are taken as well."""
        said = load_metadata(self.path)
        storage, mode = said["storage_identifier"], str(said.get("compression_mode") or "none")
        if storage not in _READERS:
            raise DamageError(f"storage {storage!r} is not supported")
        if mode.lower() != "none" and said.get("compression_format") != "zstd":
            raise DamageError(f"compression {said.get('compression_format')!r} is not supported")
        topics = said["topics_with_message_count"]
        others = {str(one["topic_metadata"]["serialization_format"]) for one in topics} - {"cdr"}
        if others:
            raise DamageError(f"serialization {listed(sorted(others))} is not supported")
        paths = [self.path / PurePosixPath(name).name for name in said["relative_file_paths"]]
        missing = [path.name for path in paths if not exists(path)]
        if missing:
            raise DamageError(f"files are missing: {missing}")
        self._is_packed = mode.lower() == "message"
        if mode.lower() == "file":
            paths = _plain(paths, Path(self._stack.enter_context(TemporaryDirectory())))
        for path in paths:
            self._opened(storage, path)
        definitions = {
            topic.type: topic.definition
            for file in reversed(self._files)
            for topic in reversed(file.topics)
            if topic.definition.format is not MessageDefinitionFormat.NONE
        }
        return [
            replace(topic, definition=definitions.get(topic.type, NO_DEFINITION))
            for topic in topics_of(said)
        ]

    def _opened(self, storage: str, path: Path) -> StorageReader:
        file = _READERS[storage](path)
        self._stack.callback(file.close)
        self._files.append(file)
        return file

    def _raw(
        self, names: tuple[str, ...], start_ns: int | None = None, stop_ns: int | None = None
    ) -> Iterator[Raw]:
        unknown = [name for name in names if name not in self.topics]
        if unknown:
            raise BagError(f"bag {self.path}: no topic {', '.join(unknown)}")
        chosen = [topic for topic in self._stored if not names or topic.name in names]
        start = -LATEST_NS if start_ns is None else start_ns
        stop = LATEST_NS + 1 if stop_ns is None else stop_ns
        stream = self._guarded(chosen, start, stop)
        read = {topic.name: 0 for topic in chosen}
        for item in stream if len(self._files) == 1 else _in_order(stream):
            read[item[0].name] += 1
            yield item
        if start_ns is None and stop_ns is None:
            self._refuse_less(read)

    def _refuse_less(self, read: Mapping[str, int]) -> None:
        """Refuse a bag with fewer readable messages than stated.

        Raises:
            MissingMessagesError: with the topic, and how many of how many.
        """
        for name, count in read.items():
            stated = self.topics[name].count
            if count < stated:
                rule = f"{count} messages can be read, of {stated} stated"
                hint = f"`hapticmech bag repair {self.path}` recovers what can be read"
                raise MissingMessagesError(f"bag {self.path} (topic {name}): {rule}; {hint}")

    def _guarded(self, chosen: Iterable[StoredTopic], start: int, stop: int) -> Iterator[Raw]:
        """Yield messages file by file.

        Topics are matched to those of the files by name and type: the metadata's QoS may have been
        edited.
        """
        known = {(topic.name, topic.type): topic for topic in chosen}
        try:
            for file in self._files:
                wanted = {
                    topic.number: known[topic.name, topic.type]
                    for topic in file.topics
                    if (topic.name, topic.type) in known
                }
                if wanted:
                    for number, time_ns, data in file.messages(wanted.keys(), start, stop):
                        plain = unpacked(data, "zstd") if self._is_packed else data
                        yield wanted[number], time_ns, plain
        except Exception as error:  # See __init__.
            raise _damaged(self.path, error) from error

    def close(self) -> None:
        """Close the bag; does nothing the second time."""
        self._stack.close()

    def __exit__(self, *_: object) -> None:
        self.close()


def read_topic(path: str | os.PathLike[str], name: str) -> Iterator[tuple[int, Any]]:
    """Yield (time of reception in ns, message) of one topic of the bag at ``path``.

    Raises:
        BagError: no such bag or topic, or damaged.
    """
    with BagReader(path) as bag:
        for item in bag.messages(name):
            yield item.time_ns, item.message


def types_of(topic: StoredTopic) -> dict[str, Any]:
    """Return the types that the definition of a topic's type has, as the library takes them.

    Raises:
        Exception: of the library; the definition cannot be read.
    """
    text = topic.definition.data
    if topic.definition.format is MessageDefinitionFormat.MSG:
        return get_types_from_msg(text, topic.type)
    found = {}
    for part in text.split(_IDL):
        # The first line of all but a definition alone is a name.
        found.update(get_types_from_idl(part.partition("\n")[2] if _IDL in text else part))
    return found


def _typestore(topics: Iterable[StoredTopic]) -> Any:
    """Return a store of the types of topics.

    Raises:
        DamageError: definitions that take long to understand, or a hash of another definition.
        Exception: of the library; a definition cannot be read.
    """
    defined = [one for one in topics if one.definition.format is not MessageDefinitionFormat.NONE]
    texts = [topic.definition.data for topic in defined]
    size, lines = sum(map(len, texts)), sum(text.count("\n") for text in texts)
    if size > DEFINITIONS_SIZE or lines > DEFINITIONS_LINES:
        rule = f"at most {DEFINITIONS_SIZE} characters in {DEFINITIONS_LINES} lines"
        raise DamageError(f"its types' definitions have {size} in {lines}: {rule}")
    if not defined:
        return get_typestore(Stores.ROS2_JAZZY)
    store = get_typestore(Stores.EMPTY)
    types: dict[str, Any] = {}
    for topic in {(one.type, one.definition): one for one in defined}.values():
        types.update(types_of(topic))
    store.register(types)
    for msgtype, said in {one.type: one.type_hash for one in defined if one.type_hash}.items():
        if (found := store.hash_rihs01(msgtype)) != said:
            raise DamageError(f"the hash of type {msgtype} is {found}, not {said}")
    return store


def _plain(paths: Iterable[Path], folder: Path) -> list[Path]:
    """Return files that were compressed as a whole, unpacked into a folder."""
    found = []
    for path in paths:
        found.append(folder / path.stem)
        trouble = unpack_file(path, found[-1])
        if trouble:
            raise DamageError(f"{path.name} {trouble}")
    return found


def topics_by_name(stored: Iterable[StoredTopic]) -> dict[str, BagTopic]:
    """Return topics by name, in order of their names; of one name several become one."""
    by_name: dict[str, list[StoredTopic]] = {}
    for topic in sorted(stored, key=lambda topic: topic.name):
        by_name.setdefault(topic.name, []).append(topic)
    return {name: _topic(found) for name, found in by_name.items()}


def _topic(found: list[StoredTopic]) -> BagTopic:
    types = {topic.type for topic in found}
    return BagTopic(
        types.pop() if len(types) == 1 else "several types",
        sum(topic.count for topic in found),
        tuple(offer for topic in found for offer in topic.offered),
        next((topic.type_hash for topic in found if topic.type_hash), ""),
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
