# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Between the thread that hears messages and the disk: a queue, and a thread that writes.

A disk that stalls delays nobody who listens. What is queued is on disk within half a second.
"""

from __future__ import annotations

import queue
import threading
import time
from collections.abc import Sequence
from typing import NamedTuple

from rosbags.interfaces import Qos

from hapticmech_ros.bag.storage import Messages
from hapticmech_ros.bag.writer import BagWriter
from hapticmech_ros.errors import BagError

FLUSH_PERIOD_S = 0.4
# Most that may wait for a disk; what comes then is dropped, and counted.
LONGEST_QUEUE_BYTES = 512 << 20
_Part = tuple[str, Messages]
_NOTHING: _Part = ("", [])


class _Topic(NamedTuple):
    """What is announced."""

    name: str
    msgtype: str
    offered: tuple[Qos, ...]


class BagSpool:
    """Writes messages to a bag from a thread of its own.

    Attributes:
        dropped: messages that found the queue full, by topic.
        failure: why writing has ended before its time; the rest is dropped.
        worst_wait_s: longest time that a write has kept the queue waiting.
    """

    def __init__(self, writer: BagWriter) -> None:
        self._writer = writer
        self._queue: queue.SimpleQueue[_Part | _Topic | None] = queue.SimpleQueue()
        self._put_bytes = self._written_bytes = 0
        self.dropped: dict[str, int] = {}
        self._lost: dict[str, int | None] = {}
        self.failure: BagError | None = None
        self.worst_wait_s = 0.0
        self._thread = threading.Thread(target=self._work, name="bag", daemon=True)
        self._thread.start()

    def add_topic(self, name: str, msgtype: str, offered: Sequence[Qos]) -> None:
        """Queue the announcement of a topic, before its first message is put.

        It takes milliseconds, in which whoever listens would lose messages; what the writer refuses
        ends writing, as a full disk does.
        """
        self._queue.put(_Topic(name, msgtype, tuple(offered)))

    def put(self, name: str, messages: Messages) -> None:
        """Queue messages of a topic."""
        if self.failure or self._put_bytes - self._written_bytes > LONGEST_QUEUE_BYTES:
            self.dropped[name] = self.dropped.get(name, 0) + len(messages)
            return
        self._put_bytes += _bytes(messages)
        self._queue.put((name, messages))

    def note_lost(self, name: str, lost: int | None) -> None:
        """Note how many messages of a topic were lost on their way; None: that is not known."""
        self._lost[name] = lost

    def close(self) -> None:
        """Write all that is queued, and finish the bag, with what was lost or dropped of it.

        Raises:
            BagError: storage full.
        """
        self._queue.put(None)
        self._thread.join()
        for name, lost in self._lost.items():
            if lost is not None:
                self._lost[name] = lost + self.dropped.get(name, 0)
        self._writer.close(self._lost)
        if self.failure:
            raise self.failure

    def _work(self) -> None:
        flushed = time.monotonic()
        while True:
            try:
                item = self._queue.get(timeout=FLUSH_PERIOD_S)
            except queue.Empty:
                item = _NOTHING
            if item is None:
                return
            begun = time.monotonic()
            try:
                if not self.failure:
                    self._write(item)
                if begun - flushed >= FLUSH_PERIOD_S and not self.failure:
                    flushed = begun
                    self._writer.flush()
            except BagError as error:
                self.failure = error
            if not isinstance(item, _Topic):
                self._written_bytes += _bytes(item[1])
            self.worst_wait_s = max(self.worst_wait_s, time.monotonic() - begun)

    def _write(self, item: _Part | _Topic) -> None:
        if isinstance(item, _Topic):
            self._writer.add_topic(item.name, item.msgtype, offered=item.offered)
        elif item[1]:
            self._writer.write_many(*item)


def _bytes(messages: Messages) -> int:
    return sum(len(data) for _, data in messages)
