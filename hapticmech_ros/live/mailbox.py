# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Where a page finds what it is told, by whatever thread."""

from __future__ import annotations

import threading

from hapticmech_ros.errors import HapticMechError
from hapticmech_ros.live.commands import Report, newest


class Mailbox:
    """Reports that nobody has taken yet; may be used from several threads.

    Args:
        ended: what an error says once no more can come.
    """

    def __init__(self, ended: str) -> None:
        self._ended, self._is_closed = ended, False
        self._came = threading.Condition()
        self._news: list[Report] = []

    def put(self, report: Report) -> None:
        """Add a report; of states only the newest is kept."""
        with self._came:
            self._news = newest([*self._news, report])
            self._came.notify_all()

    def close(self) -> None:
        """Say that no more will come."""
        with self._came:
            self._is_closed = True
            self._came.notify_all()

    def first(self, timeout_s: float) -> Report | None:
        """Return what is to be taken first, and leave it there; None if nothing has come in time.

        Args:
            timeout_s: how long to wait for anything, s.

        Raises:
            HapticMechError: nothing is left, and no more can come.
        """
        with self._came:
            self._wait(timeout_s)
            return self._news[0] if self._news else None

    def take(self, timeout_s: float) -> list[Report]:
        """Return all that has come, in its order.

        Args:
            timeout_s: how long to wait for anything, s.

        Raises:
            HapticMechError: nothing is left, and no more can come.
        """
        with self._came:
            self._wait(timeout_s)
            found, self._news = self._news, []
        return found

    def _wait(self, timeout_s: float) -> None:
        self._came.wait_for(lambda: self._news or self._is_closed, timeout_s)
        if self._is_closed and not self._news:
            raise HapticMechError(self._ended)
