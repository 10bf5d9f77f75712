# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Contents of a bag, by its index alone, and a check for damage.

Whole: every message decodes, stamps increase, nothing is missing in between.
"""

from __future__ import annotations

import os
import re
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rosbags.typesys import Stores, get_typestore

from hapticmech_ros.bag.metadata import is_unfinished, losses_of, read_metadata, topics_of
from hapticmech_ros.bag.reader import BagReader, BagTopic, MissingMessagesError, topics_by_name
from hapticmech_ros.bag.storage import SUFFIXES, DamageError
from hapticmech_ros.errors import BagError
from hapticmech_ros.files import exists
from hapticmech_ros.numerics.times import NANOSECONDS
from hapticmech_ros.wire.topics import TOPICS, topic_of


@dataclass(frozen=True, slots=True)
class TopicInfo:
    """One topic: rate in Hz over the bag's duration; QoS of its publishers, each value once."""

    name: str
    type: str
    count: int
    rate_hz: float
    publishers: int
    reliability: tuple[str, ...]
    durability: tuple[str, ...]
    type_hash: str


@dataclass(frozen=True, slots=True)
class FileInfo:
    """One storage file: size on disk, and the metadata's figures of its messages.

    None where they are missing, or the duration is invalid: negative, or longer than the bag's.
    """

    name: str
    bytes: int
    messages: int | None
    duration_s: float | None


@dataclass(frozen=True, slots=True)
class BagInfo:
    """Contents of a bag.

    Attributes:
        path: of the bag.
        storage: ``mcap`` or ``sqlite3``.
        finished: False while it is recorded, or if the recording was cut short; counts and times
            are then those of the last time that metadata were written.
        version: of the metadata; None for a single file.
        distribution: ROS distribution that wrote it; empty if unknown.
        compression: such as ``zstd (message)``; empty for none.
        start_ns: time of the first message, ns; 0 for an empty bag.
        duration_s: from the first to the last message, s.
        messages: in all.
        files: in order.
        topics: by name.
        lost: messages that the recording lost, of each topic that lost any (None: not known); None
            where the recorder has not counted.
    """

    path: Path
    storage: str
    finished: bool
    version: int | None
    distribution: str
    compression: str
    start_ns: int
    duration_s: float
    messages: int
    files: tuple[FileInfo, ...]
    topics: tuple[TopicInfo, ...]
    lost: Mapping[str, int | None] | None = None

    @property
    def bytes(self) -> int:
        """Size of all files on disk."""
        return sum(file.bytes for file in self.files)

    def as_dict(self) -> dict[str, Any]:
        """Return everything for JSON."""
        return {**asdict(self), "path": str(self.path), "bytes": self.bytes}


def inspect_bag(path: str | os.PathLike[str]) -> BagInfo:
    """Return the contents of the bag at ``path``: a folder, or a single file.

    Raises:
        BagError: no such bag, damaged, or without metadata.
    """
    folder = Path(path)
    if not exists(folder):
        raise BagError(f"no bag at {folder}")
    information = read_metadata(folder) if folder.is_dir() else {}
    finished = not is_unfinished(information)
    if finished:
        with BagReader(folder) as bag:
            topics, (first, last) = bag.topics, bag.span_ns
    else:
        try:
            topics = topics_by_name(topics_of(information))
        except DamageError as error:
            raise BagError(f"bag {folder}: metadata that cannot be read: {error}") from error
        first = information["starting_time"]["nanoseconds_since_epoch"]
        last = first + max(0, information["duration"]["nanoseconds"])
        if not information["message_count"]:
            first = last = 0
    duration = (last - first) / NANOSECONDS
    return BagInfo(
        folder,
        str(information.get("storage_identifier") or SUFFIXES[folder.suffix]),
        finished,
        information.get("version"),
        str(information.get("ros_distro") or ""),
        _compression(information),
        first,
        duration,
        sum(topic.count for topic in topics.values()),
        _files(folder, information, last - first),
        tuple(_topic_info(name, topic, duration) for name, topic in topics.items()),
        losses_of(information),
    )


def _topic_info(name: str, topic: BagTopic, duration: float) -> TopicInfo:
    # n messages at an even rate span n - 1 periods.
    rate = (topic.count - 1) / duration if duration > 0.0 and topic.count > 1 else 0.0
    return TopicInfo(
        name,
        topic.type,
        topic.count,
        rate,
        len(topic.offered),
        tuple(sorted({offer.reliability.name.lower() for offer in topic.offered})),
        tuple(sorted({offer.durability.name.lower() for offer in topic.offered})),
        topic.type_hash,
    )


def _files(folder: Path, information: dict[str, Any], span_ns: int) -> tuple[FileInfo, ...]:
    if not information:
        return (FileInfo(folder.name, folder.stat().st_size, None, None),)
    told = {entry.get("path"): entry for entry in information.get("files") or []}
    found = []
    for name in information.get("relative_file_paths") or []:
        file = folder / Path(name).name
        entry = told.get(name, {})
        lasted = entry["duration"]["nanoseconds"] if "duration" in entry else -1
        found.append(
            FileInfo(
                file.name,
                file.stat().st_size if file.exists() else 0,
                entry.get("message_count"),
                lasted / NANOSECONDS if 0 <= lasted <= span_ns else None,
            )
        )
    return tuple(found)


def _compression(information: dict[str, Any]) -> str:
    mode = str(information.get("compression_mode") or "").lower()
    return f"{information.get('compression_format')} ({mode})" if mode not in ("", "none") else ""


# A topic counts as periodic if so many of its periods are that near to the median.
PERIODIC_SHARE, PERIODIC_WITHIN = 0.9, 0.25


@dataclass(frozen=True, slots=True)
class TopicCheck:
    """Report on one topic.

    Attributes:
        name: of the topic.
        type: of its messages.
        count: messages read.
        rate_hz: by the median period; 0 for less than two messages.
        stamped: whether times are the senders' stamps, or else those of reception.
        backwards: stamps that are earlier than the one before.
        repeated: stamps that are the same as the one before.
        largest_gap_s: longest time between neighbours.
        gaps: places in which a periodic topic's stamps are missing.
        lost: how many are missing there: not sent, or not received. None for a topic that is not
            periodic, or not stamped: times of reception do not show it, as messages may come in
            bursts.
        undecodable: messages that cannot be decoded.
        notes: anything else, such as a missing QoS.
    """

    name: str
    type: str
    count: int
    rate_hz: float
    stamped: bool
    backwards: int
    repeated: int
    largest_gap_s: float
    gaps: int
    lost: int | None
    undecodable: int
    notes: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class BagCheck:
    """Report on a bag.

    Attributes:
        path: of the bag.
        damage: found in the bag; empty for a sound one.
        topics: by name.
        absent: topics of this package's graph that were not recorded, if others were.
    """

    path: Path
    damage: tuple[str, ...]
    topics: tuple[TopicCheck, ...]
    absent: tuple[str, ...]

    @property
    def is_empty(self) -> bool:
        """Whether it has no messages, or, of this package's graph, none of the control rate."""
        counts = {topic.name: topic.count for topic in self.topics}
        known = {name: topic_of(name) for name in counts}
        control = [name for name, topic in known.items() if topic and topic.rate == "control"]
        return not any(counts[name] for name in control or counts)

    @property
    def is_sound(self) -> bool:
        """Whether there is something in it, and everything can be read."""
        return not self.damage and not self.is_empty

    def as_dict(self) -> dict[str, Any]:
        """Return everything for JSON."""
        return {
            **asdict(self),
            "path": str(self.path),
            "empty": self.is_empty,
            "sound": self.is_sound,
        }


@dataclass(slots=True)
class _Series:
    received: list[int] = field(default_factory=list)
    stamps: list[int] = field(default_factory=list)
    undecodable: int = 0


def check(path: str | os.PathLike[str]) -> BagCheck:
    """Read a whole bag, and return a report.

    Raises:
        BagError: no bag at ``path``. Faults of a bag are in the report.
    """
    if not exists(path):
        raise BagError(f"no bag at {path}")
    try:
        with BagReader(path) as bag:
            return _check(bag)
    except BagError as error:
        return BagCheck(Path(path), (str(error),), (), ())


def _check(bag: BagReader) -> BagCheck:
    series = {name: _Series() for name in bag.topics}
    damage = []
    try:
        _read(bag, series)
    except MissingMessagesError:
        pass  # Reported below, for every topic.
    except BagError as error:
        damage.append(str(error))
    for name, topic in bag.topics.items():
        read = len(series[name].received)
        if read != topic.count:
            damage.append(f"topic {name}: {read} messages can be read, of {topic.count} stated")
        if series[name].undecodable:
            damage.append(f"topic {name}: {series[name].undecodable} messages cannot be decoded")
    topics = tuple(_topic(name, bag.topics[name], found) for name, found in series.items())
    return BagCheck(bag.path, tuple(damage), topics, absent(list(bag.topics)))


def _read(bag: BagReader, series: dict[str, _Series]) -> None:
    stamps_of = {name: bag.stamps_of(name) for name in bag.topics}
    for name, time_ns, data in bag.serialized():
        found = series[name]
        found.received.append(time_ns)
        try:
            bag.decode(name, data)
        except BagError:
            found.undecodable += 1
            continue
        read = stamps_of[name]
        stamp = read(data) if read else None
        if stamp:
            found.stamps.append(stamp)


def _topic(name: str, topic: BagTopic, found: _Series) -> TopicCheck:
    stamped = bool(found.stamps) and len(found.stamps) == len(found.received)
    times = np.array(found.stamps if stamped else found.received, dtype=np.int64)
    steps: NDArray[np.int64] = times[1:] - times[:-1]
    different = np.unique(times)
    forward: NDArray[np.int64] = different[1:] - different[:-1]
    period = float(np.median(forward)) if forward.size else 0.0
    lost, gaps = _missing(forward, period) if stamped else (None, 0)
    return TopicCheck(
        name,
        topic.type,
        len(found.received),
        NANOSECONDS / period if period else 0.0,
        stamped,
        int((steps < 0).sum()),
        int((steps == 0).sum()) if stamped else 0,
        float(forward.max(initial=0)) / NANOSECONDS,
        gaps,
        lost,
        found.undecodable,
        _notes(topic),
    )


def _missing(steps: NDArray[np.int64], period: float) -> tuple[int | None, int]:
    """Return how many messages are missing between the others, and in how many places."""
    if steps.size < 2:
        return None, 0
    even = np.abs(steps - period) <= PERIODIC_WITHIN * period
    if even.mean() < PERIODIC_SHARE:
        return None, 0
    missing = np.rint(steps / period).astype(int) - 1
    return int(missing[missing > 0].sum()), int((missing > 0).sum())


def _notes(topic: BagTopic) -> tuple[str, ...]:
    notes = []
    if not topic.offered:
        notes.append("no QoS of its publishers")
    if not topic.type_hash:
        notes.append("no hash of its type")
    else:
        store = get_typestore(Stores.ROS2_JAZZY)
        if topic.type in store.types and store.hash_rihs01(topic.type) != topic.type_hash:
            notes.append("its type is not the one of ROS 2 Jazzy")
    return tuple(notes)


# Rates of topics that not every scene has.
OPTIONAL = frozenset(("contact", "body", "servo", "shared"))


def absent(names: list[str]) -> tuple[str, ...]:
    """Return the topics that a graph of this package publishes and ``names`` lacks.

    Empty if none of them is there; only scenes with contacts publish contact points.
    ``{point}`` stands for an operational point.
    """
    declared = [t.name for t in TOPICS if t.publisher != "any" and t.rate not in OPTIONAL]
    missing = [name for name in declared if not any(_is(name, other) for other in names)]
    ours = {name for name in declared if not name.startswith("/")}
    return () if ours <= set(missing) else tuple(missing)


def _is(declared: str, name: str) -> bool:
    pattern = re.escape(declared).replace(re.escape("{point}"), "[^/]+")
    prefix = "" if declared.startswith("/") else "/(.*/)?"
    return re.fullmatch(prefix + pattern, name) is not None
