# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Where the cursor of an Inverse3 is, without commanding anything but no force."""

from __future__ import annotations

import time
from contextlib import ExitStack

import numpy as np

from hapticmech_ros.arrays import Array
from hapticmech_ros.errors import HapticMechError, InvalidInputError
from hapticmech_ros.haply.link import Link, LinkError
from hapticmech_ros.haply.messages import (
    Cursor,
    cursor_of,
    force_command,
    found_in,
    greeting,
    parsed,
)

# s until the service has answered; and between two looks.
PATIENCE, _ROUND = 5.0, 0.002


class CursorReader:
    """Reads the cursor for as long as it is asked to.

    Args:
        uri: of the service.
        device_id: of the Inverse3; empty: the only one there is.

    Raises:
        LinkError: the service does not answer, or has no such device.
        InvalidInputError: a frame that breaks a rule.

    Attributes:
        device_id: of the Inverse3 that was found.
        known: what the service says of its configuration.
    """

    def __init__(self, uri: str, device_id: str = "") -> None:
        self._link = Link(uri)
        with ExitStack() as stack:
            stack.callback(self.close)
            found = found_in(parsed(self._first()), device_id)
            if found is None:
                raise LinkError(f"{uri}: the service has no Inverse3 {device_id}".rstrip())
            self.device_id, self.known = found.device_id, found.known
            self._link.send(greeting(self.device_id))
            self._answer()
            stack.pop_all()

    def path(self, seconds: float) -> Array:
        """Return where the cursor is for a while, (n, 3), axes of the base, m."""
        end, found = time.monotonic() + seconds, list[Array]()
        while time.monotonic() < end:
            found.append(self._read().position)
            time.sleep(_ROUND)
        return np.array(found)

    def mean(self, seconds: float) -> Array:
        """Return the mean of where the cursor is for a while, (3,)."""
        place: Array = self.path(seconds).mean(axis=0)
        return place

    def close(self) -> None:
        """End the connection."""
        self._link.close()

    def _read(self) -> Cursor:
        self._link.send(force_command(self.device_id, (0.0, 0.0, 0.0)))
        cursor = cursor_of(parsed(self._answer()), self.device_id)
        if cursor is None:
            raise InvalidInputError("frame", self.device_id, "must have the device")
        return cursor

    def _first(self) -> str:
        """Return what the service says on connection."""
        end = time.monotonic() + PATIENCE
        while not self._link.is_open:
            if time.monotonic() > end:
                raise LinkError(self._link.problem)
            self._link.look()
            time.sleep(_ROUND)
        return self._answer()

    def _answer(self) -> str:
        frames = self._link.answers(PATIENCE)
        if not frames:
            raise HapticMechError(self._link.problem or "the service does not answer")
        return frames[-1]
