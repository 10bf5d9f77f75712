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

from hapticmech_ros.bag.writer import BagWriter
from hapticmech_ros.errors import BagError

FLUSH_PERIOD_S = 0.4
# Most that may wait for a disk; what comes then is dropped, and counted.
LONGEST_QUEUE_BYTES = 512 << 20
_Message = tuple[str, int, bytes]
_NOTHING: _Message = ("", 0, b"")


class _Topic(NamedTuple):
    """What is announced."""

    name: str
    msgtype: str
    offered: tuple[Qos, ...]


class BagSpool:
    """Writes messages to a bag from a thread of its own.

    Attributes:
        dropped: messages that found the queue full.
        failure: why writing has ended before its time; the rest is dropped.
        worst_wait_s: longest time that a write has kept the queue waiting.
    """

    def __init__(self, writer: BagWriter) -> None:
        self._writer = writer
        self._queue: queue.SimpleQueue[_Message | _Topic | None] = queue.SimpleQueue()
        self._put_bytes = self._written_bytes = 0
        self.dropped = 0
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

    def put(self, name: str, time_ns: int, data: bytes) -> None:
        """Queue a message."""
        if self.failure or self._put_bytes - self._written_bytes > LONGEST_QUEUE_BYTES:
            self.dropped += 1
            return
        self._put_bytes += len(data)
        self._queue.put((name, time_ns, data))

    def close(self) -> None:
        """Write all that is queued, and finish the bag.

        Raises:
            BagError: storage full.
        """
        self._queue.put(None)
        self._thread.join()
        self._writer.close()
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
                self._written_bytes += len(item[2])
            self.worst_wait_s = max(self.worst_wait_s, time.monotonic() - begun)

    def _write(self, item: _Message | _Topic) -> None:
        if isinstance(item, _Topic):
            self._writer.add_topic(item.name, item.msgtype, offered=item.offered)
        elif item[0]:
            self._writer.write(*item)
