# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Reads messages ahead in a thread, so that a slow disk does not delay their publication."""

from __future__ import annotations

import queue
import threading
from collections.abc import Iterator
from types import TracebackType

from hapticmech_ros.bag.schedule import Message
from hapticmech_ros.errors import BagError

MOST_AHEAD = 4000
_POLL_S = 0.1


class Prefetch:
    """A queue of messages that a thread fills while its block lasts."""

    def __init__(self, messages: Iterator[Message]) -> None:
        self._messages = messages
        self._queue: queue.Queue[Message | BagError | None] = queue.Queue(MOST_AHEAD)
        self._ended = False
        self._thread = threading.Thread(target=self._work, name="prefetch", daemon=True)

    def take(self) -> Message | None:
        """Return the next message, or None behind the last.

        Raises:
            BagError: the bag is damaged here.
        """
        item = self._queue.get()
        if isinstance(item, BagError):
            raise item
        return item

    def _work(self) -> None:
        try:
            for message in self._messages:
                if not self._put(message):
                    return
            self._put(None)
        except BagError as error:
            self._put(error)

    def _put(self, item: Message | BagError | None) -> bool:
        while not self._ended:
            try:
                self._queue.put(item, timeout=_POLL_S)
            except queue.Full:
                continue
            return True
        return False

    def __enter__(self) -> Prefetch:
        self._thread.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._ended = True
        self._thread.join()
