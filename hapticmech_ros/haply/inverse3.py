# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""An Inverse3 as a device that is driven: one message and one sample each period."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping

import numpy as np

from hapticmech_ros.device.real_device import Measured, RealDevice
from hapticmech_ros.device.state import NO_WRENCH
from hapticmech_ros.errors import InvalidInputError
from hapticmech_ros.haply.messages import (
    Cursor,
    Link,
    cursor_of,
    force_command,
    found_in,
    greeting,
    parsed,
    whole_state,
)
from hapticmech_ros.numerics import Array
from hapticmech_ros.scene import Scene

# Of a period, how long an answer is waited for: a sample of this period, not of the last one.
WAIT_SHARE = 0.4
# m and m/s: a cursor that is further from where it was has not moved there.
_LEAP, _FASTEST = 0.02, 10.0
# s without a device after which the service's first report is requested again.
_ASK_AGAIN_S = 0.5


class Inverse3(RealDevice):
    """Sends forces to an Inverse3 and takes its samples.

    Args:
        link: to the service.
        scene: to render; its ``device`` describes the Inverse3.
        mounting: (3, 3) axes of the device's base in the world.
        device_id: of the Inverse3; empty: the only one there is.
        silence: s without a valid sample after which the connection is ended.
        clock: monotonic, s.

    Raises:
        InvalidInputError: a scene with another device.

    Attributes:
        refused, connections_lost: counts of frames that break a rule, and of connections that
            ended.
        known: the device's configuration, from the service.
    """

    def __init__(
        self,
        link: Link,
        scene: Scene,
        mounting: Array,
        device_id: str,
        silence: float,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        super().__init__(scene, mounting, silence, clock)
        self._link = link
        self._wanted, self._identity = device_id, ""
        self._wait = WAIT_SHARE * scene.simulation.period
        self._cursor: Cursor | None = None
        self._received = self._asked = -np.inf
        self._was_open = False
        self.problem = link.problem
        self.refused = self.connections_lost = 0
        self.known: Mapping[str, str] = {}

    def look(self) -> bool:
        """Go on connecting if it is not connected; return whether the device is there."""
        self._link.look()
        if not self._link.is_open:
            self._lose(self._link.problem)
        elif not self._identity:
            if not self._was_open:
                # The service's first report is in flight.
                self._was_open, self._asked = True, self._clock()
            self._find()
        elif self._left() < 0.0:
            self._leave()
        elif self._cursor is not None:
            self.problem = self._cursor.refusal
        return bool(self._identity)

    def exchange(self, wrench: Array, now: float) -> tuple[bool, Measured | None]:
        """Send a force and take the answer if it comes.

        Args:
            wrench: (6,) on the hand, N and N m, axes of the base; its torque is not given.
            now: by the clock, s.

        Returns:
            Whether the force was sent, and the measurement; None without a sample.
        """
        # A message that still waits for its answer is not followed by another one.
        sent = self._link.send(force_command(self._identity, wrench[:3].tolist()))
        return sent, self._last if self._answered(now, self._wait) else None

    def let_go(self) -> None:
        """Command no force now, not with the next period.

        An answer that is still to come is waited for, as long as the device does not count as lost;
        then the connection is ended.
        """
        if not self._identity:
            return
        if self._link.unanswered:
            self._answered(self._clock(), max(self._left(), 0.0))
        if self._link.send(force_command(self._identity, (0.0, 0.0, 0.0))):
            self._given = NO_WRENCH
        else:
            self._leave()

    def close(self) -> None:
        """Command no force and end the connection, which makes the service end its force."""
        self.let_go()
        self._link.close()

    def figures(self) -> dict[str, str]:
        """Return its entries for diagnostics."""
        return {
            **super().figures(),
            "device_id": self._identity,
            "connections": str(self._link.connections),
            "connections_lost": str(self.connections_lost),
            "refused_frames": str(self.refused),
            "orientation": self._orientation,
            **self.known,
        }

    @property
    def _orientation(self) -> str:
        if self._cursor is None:
            return ""
        return "constant" if self._cursor.orientation is None else "of the handle"

    def _find(self) -> None:
        """Look for the device in the service's first report."""
        frames, now = self._link.answers(0.0), self._clock()
        if not frames:
            if now - self._asked > _ASK_AGAIN_S and self._link.send(whole_state()):
                self._asked = now
            return
        try:
            found = found_in(parsed(frames[-1]), self._wanted)
        except InvalidInputError as error:
            self.refused += 1
            self.problem, self._asked = str(error), now
            return
        if found is None:
            which = f"Inverse3 {self._wanted!r}" if self._wanted else "Inverse3"
            self.problem, self._asked = f"the service has no {which}", now
        elif self._link.send(greeting(found.device_id)):
            self._identity, self.known = found.device_id, found.known
            self._take(found.cursor, now)

    def _left(self) -> float:
        """Return after how many s without a sample the device counts as lost."""
        return self.silence - (self._clock() - self._received)

    def _answered(self, now: float, wait: float) -> bool:
        """Take the newest frame that comes within ``wait`` s; return whether there was one."""
        found = False
        for text in self._link.answers(wait):
            try:
                cursor = cursor_of(parsed(text), self._identity)
                if cursor is None:
                    raise InvalidInputError("frame", text[:80], f"must have {self._identity}")
                self._check_leap(cursor, now)
                self._take(cursor, now)
                found = True
            except InvalidInputError:
                self.refused += 1
        return found

    def _take(self, cursor: Cursor, now: float) -> None:
        self._cursor, self._received, self.problem = cursor, now, cursor.refusal
        self._last = Measured(cursor.position, cursor.velocity, cursor.orientation)
        self.buttons = cursor.buttons

    def _check_leap(self, cursor: Cursor, now: float) -> None:
        """Refuse a place to which no hand can have moved it.

        Raises:
            InvalidInputError: it is too far from the last one.
        """
        if self._cursor is None:
            return
        way = float(np.linalg.norm(cursor.position - self._cursor.position))
        most = _LEAP + _FASTEST * (now - self._received)
        if way > most:
            rule = f"must be within {most:.3g} m of before"
            raise InvalidInputError("cursor_position", way, rule)

    def _leave(self) -> None:
        """End the connection to a device that does not answer."""
        self._lose(f"no valid sample of the Inverse3 for {1e3 * self.silence:.0f} ms")
        self._link.close(self.problem)

    def _lose(self, problem: str) -> None:
        """Note that there is no device any more."""
        if self._was_open:
            self.connections_lost += 1
        self._was_open, self._identity, self._cursor = False, "", None
        self.problem = problem
        self.forget()
