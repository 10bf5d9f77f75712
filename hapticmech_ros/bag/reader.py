"""Reads rosbag2 files: what is in them, and their messages in order of time."""

from __future__ import annotations

import os
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Any, NamedTuple

from rosbags.highlevel import AnyReader
from rosbags.interfaces import Connection
from rosbags.typesys import Stores, get_typestore

from hapticmech_ros.errors import BagError


@dataclass(frozen=True, slots=True)
class BagTopic:
    """A topic of a bag: message type, and number of messages."""

    type: str
    count: int


class BagMessage(NamedTuple):
    """A message of a bag: topic, time of reception in ns, and the message itself."""

    topic: str
    time_ns: int
    message: Any


class BagReader:
    """An open bag: a rosbag2 folder, or a single ``.mcap`` or ``.db3`` file.

    Use it as a context manager.

    Raises:
        BagError: not there, not a bag, or not finished by its writer.
    """

    def __init__(self, path: str | os.PathLike[str]) -> None:
        self.path = Path(path)
        if not self.path.exists():
            raise BagError(f"no bag at {self.path}")
        if self.path.is_dir() and not (self.path / "metadata.yaml").is_file():
            raise BagError(
                f"bag {self.path} has no metadata.yaml: not a bag, or its recording was cut short"
            )
        try:
            store = get_typestore(Stores.ROS2_JAZZY)
            self._reader = AnyReader([self.path], default_typestore=store)
            self._reader.open()
        except Exception as error:  # Decoders of three formats raise anything on damaged bytes.
            raise _damaged(self.path, error) from error
        self._is_open = True
        self.topics: dict[str, BagTopic] = {
            name: BagTopic(info.msgtype or "several types", info.msgcount)
            for name, info in sorted(self._reader.topics.items())
        }

    @property
    def span_ns(self) -> tuple[int, int]:
        """Times of the first and the last message, ns; zeros for an empty bag."""
        if self._reader.message_count == 0:
            return 0, 0
        return self._reader.start_time, self._reader.end_time - 1

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

    def serialized(self, *names: str) -> Iterator[tuple[str, int, bytes]]:
        """Yield topic, time (ns) and CDR bytes of messages, otherwise as :meth:`messages`."""
        for connection, time_ns, data in self._raw(names):
            yield connection.topic, time_ns, bytes(data)

    def _raw(self, names: tuple[str, ...]) -> Iterator[tuple[Connection, int, bytes]]:
        unknown = [name for name in names if name not in self.topics]
        if unknown:
            raise BagError(f"bag {self.path}: no topic {', '.join(unknown)}")
        chosen = [c for c in self._reader.connections if not names or c.topic in names]
        if not chosen:
            return
        stream = self._reader.messages(connections=chosen)
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


def _damaged(path: Path, error: Exception, topic: str = "") -> BagError:
    where = f" (topic {topic})" if topic else ""
    reason = str(error) or type(error).__name__
    return BagError(f"bag {path}{where} is damaged, or its recording was cut short: {reason}")
