# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Between a page's threads and the node's: commands one way, reports the other."""

from __future__ import annotations

from collections import deque

from hapticmech_ros.live.commands import (
    Command,
    Drag,
    DragStiffness,
    Hold,
    Release,
    Report,
    SwitchClosure,
    Tune,
)
from hapticmech_ros.live.process import Mailbox


class PageLink:
    """What a page on a graph asks for, and what it is told; for one node and several threads."""

    def __init__(self) -> None:
        self._asked: deque[Command] = deque()
        self._told = Mailbox("the node of this page has ended")

    @property
    def takes(self) -> frozenset[type]:
        """Commands that a graph obeys: it is neither paused, begun anew nor recorded from here."""
        return frozenset((Drag, Release, DragStiffness, Tune, SwitchClosure, Hold))

    def send(self, command: Command) -> None:
        """Ask the node for something."""
        self._asked.append(command)

    def news(self, timeout_s: float) -> list[Report]:
        """Return what the node has told: of states only the newest, the others in their order.

        Args:
            timeout_s: how long to wait for anything.

        Raises:
            HapticMechError: the node has ended.
        """
        return self._told.take(timeout_s)

    def asked(self) -> list[Command]:
        """Return what was asked for since the last time, in its order."""
        return [self._asked.popleft() for _ in range(len(self._asked))]

    def tell(self, report: Report) -> None:
        """Tell the page something."""
        self._told.put(report)

    def close(self) -> None:
        """Tell nothing more."""
        self._told.close()
