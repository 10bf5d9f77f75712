# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Whose mouse has got hold of what, and to where it pulls."""

from __future__ import annotations

import threading
from collections.abc import Callable

import numpy as np

from hapticmech_ros.arrays import Array
from hapticmech_ros.live.commands import Command, Drag, Release
from hapticmech_ros.live.drag_spring import on_plane


class Mouse:
    """The one drag that a session has; may be used from several threads.

    Args:
        send: tells the session a command.
    """

    def __init__(self, send: Callable[[Command], None]) -> None:
        self._send = send
        self._lock = threading.Lock()
        self._client: int | None = None
        self._height: float | None = None
        self._offset = np.zeros(3)
        self._drag: Drag | None = None

    def grab(
        self,
        client: int,
        link: str,
        grip: Array,
        held: Array,
        eye: Array,
        seen: Array,
        planar: bool,
    ) -> None:
        """Take hold, unless somebody else has hold of something.

        Args:
            client: whose mouse it is.
            link: that is grabbed; the hand if empty.
            grip: (3,) where in the link's frame, m.
            held: (3,) where that is now, m, world axes.
            eye: (3,) from where it is seen, likewise.
            seen: (3,) that the mouse points at, likewise.
            planar: whether it is pulled in the plane z = const. alone.
        """
        with self._lock:
            if self._client not in (None, client):
                return
            self._client = client
            self._height = float(held[2]) if planar else None
            self._offset = held - self._pointed_at(eye, seen)
            self._drag = Drag(link, grip, np.array(held))
            self._send(self._drag)

    def move(self, client: int, eye: Array, seen: Array) -> None:
        """Pull to where the mouse points now, if this client has hold of something.

        Args:
            client: whose mouse it is.
            eye: (3,) from where it is seen, m, world axes.
            seen: (3,) that the mouse points at, likewise.
        """
        with self._lock:
            if self._client != client or self._drag is None:
                return
            goal = self._pointed_at(eye, seen) + self._offset
            self._drag = Drag(self._drag.link, self._drag.grip, goal)
            self._send(self._drag)

    def let_go(self, client: int | None = None) -> None:
        """End the drag of a client, or whoever's it is if None."""
        with self._lock:
            if self._drag is None or client not in (None, self._client):
                return
            self._client = self._drag = None
            self._send(Release())

    def repeat(self) -> None:
        """Tell the session again what is dragged: without that it lets go by itself.

        A mouse that is held still says nothing, and its page is known to be there otherwise.
        """
        with self._lock:
            if self._drag is not None:
                self._send(self._drag)

    def _pointed_at(self, eye: Array, seen: Array) -> Array:
        return np.array(seen) if self._height is None else on_plane(eye, seen, self._height)
