# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Whose mouse has got hold of what, and to where it pulls.

The spring by which the mouse drags: its stiffness, its damping, and how far it may pull.

It is sampled at every tick, like a controller: stiffness and damping are bounded by the mass that
they move and the period, so that the spring itself is stable at any setting.
"""

from __future__ import annotations

import threading
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from hapticmech_ros.arrays import Array
from hapticmech_ros.errors import InvalidInputError
from hapticmech_ros.live.commands import Command, Drag, Draggable, Release

# Of the sampled spring: at most this angle ω T a period, and this share of the velocity a period.
MOST_ANGLE, MOST_BRAKING = 0.25, 0.25
# A ray this near to the plane (sine of the angle) does not tell where on it somebody points.
_GRAZING = 0.05


@dataclass(frozen=True, slots=True)
class DragSpring:
    """A spring and damper with a limit.

    Attributes:
        stiffness: N/m.
        damping: N s/m.
        limit: N, of the force.
    """

    stiffness: float
    damping: float
    limit: float

    def force(self, place: Array, velocity: Array, goal: Array) -> Array:
        """Return the force (3,) on a grip, N, world axes.

        Args:
            place: (3,) of the grip, m, world axes.
            velocity: (3,) of the grip, m/s, world axes.
            goal: (3,) to where it is pulled, m, world axes.
        """
        wanted = self.stiffness * (goal - place) - self.damping * velocity
        size = float(np.linalg.norm(wanted))
        return np.asarray(wanted if size <= self.limit else wanted * (self.limit / size))


def drag_spring(
    stiffness: float, felt: float, moved: float, period: float, limit: float
) -> DragSpring:
    """Return a critically damped spring, as stiff as it may be.

    Args:
        stiffness: that is wanted, N/m.
        felt: mass (kg) that it is to be critically damped with.
        moved: least mass (kg) that it moves at once, which bounds both.
        period: of the session, s.
        limit: N, of the force.

    Raises:
        InvalidInputError: a number that is not positive and finite.
    """
    given = {"stiffness": stiffness, "felt": felt, "moved": moved, "period": period, "limit": limit}
    for name, value in given.items():
        if not (np.isfinite(value) and value > 0.0):
            raise InvalidInputError(f"{name} of a drag", value, "must be positive and finite")
    bounded = min(stiffness, (MOST_ANGLE / period) ** 2 * moved)
    damping = min(2.0 * float(np.sqrt(bounded * felt)), MOST_BRAKING / period * moved)
    return DragSpring(bounded, damping, limit)


def on_plane(eye: Array, seen: Array, height: float) -> Array:
    """Return where (3,) a ray of sight meets the plane z = ``height``, m, world axes.

    Where the ray grazes the plane, or leads away from it, it is the place seen put on the plane.

    Args:
        eye: (3,) from where somebody looks.
        seen: (3,) on the ray.
        height: of the plane, m.
    """
    ray = seen - eye
    length = float(np.linalg.norm(ray))
    if length > 0.0 and abs(ray[2]) > _GRAZING * length:
        share = (height - eye[2]) / ray[2]
        if share > 0.0:
            return np.asarray(eye + share * ray)
    return np.array((seen[0], seen[1], height))


@dataclass(slots=True)
class _Held:
    """What a mouse has got hold of: its last command, and how its goal follows from a ray."""

    drag: Drag
    height: float | None
    offset: Array

    def pointed_at(self, eye: Array, seen: Array) -> Array:
        """Return where (3,) the ray from an eye (3,) through what is seen (3,) leads, m."""
        return np.array(seen) if self.height is None else on_plane(eye, seen, self.height)


class Mice:
    """The drags of all clients; may be used from several threads.

    A client drags one body at a time, and a body is dragged by one client at a time.

    Args:
        send: tells the session a command.
    """

    def __init__(self, send: Callable[[Command], None]) -> None:
        self._send = send
        self._lock = threading.Lock()
        self._held: dict[int, _Held] = {}

    def grab(
        self,
        client: int,
        body: Draggable,
        grip: Array,
        held: Array,
        eye: Array,
        seen: Array,
        planar: bool,
    ) -> int:
        """Take hold of a body, unless another client has it.

        Args:
            client: whose mouse it is.
            body: that is grabbed.
            grip: (3,) where in the link's frame, m.
            held: (3,) where that is now, m, world axes.
            eye: (3,) from where it is seen, likewise.
            seen: (3,) that the mouse points at, likewise.
            planar: whether it is pulled in the plane z = const. alone.

        Returns:
            Who has it now: this client, or the other one.
        """
        with self._lock:
            holder = self._holders().get(body, client)
            if holder != client:
                return holder
            self._let_go(client)
            drag = Drag(body, grip, np.array(held))
            found = _Held(drag, float(held[2]) if planar else None, np.zeros(3))
            found.offset = held - found.pointed_at(eye, seen)
            self._held[client] = found
            self._send(drag)
            return client

    def move(self, client: int, eye: Array, seen: Array) -> None:
        """Pull to where the mouse points now, if this client has hold of something.

        Args:
            client: whose mouse it is.
            eye: (3,) from where it is seen, m, world axes.
            seen: (3,) that the mouse points at, likewise.
        """
        with self._lock:
            held = self._held.get(client)
            if held is not None:
                held.drag = replace(held.drag, goal=held.pointed_at(eye, seen) + held.offset)
                self._send(held.drag)

    def let_go(self, client: int | None = None) -> None:
        """End the drag of a client, or all of them if None."""
        with self._lock:
            for one in list(self._held) if client is None else [client]:
                self._let_go(one)

    def holders(self) -> dict[Draggable, int]:
        """Return which client drags each body that is dragged."""
        with self._lock:
            return self._holders()

    def repeat(self) -> None:
        """Tell the session again what is dragged: without that it lets go by itself.

        A mouse that is held still says nothing, and its page is known to be there otherwise.
        """
        with self._lock:
            for held in self._held.values():
                self._send(held.drag)

    def _holders(self) -> dict[Draggable, int]:
        return {held.drag.body: client for client, held in self._held.items()}

    def _let_go(self, client: int) -> None:
        held = self._held.pop(client, None)
        if held is not None:
            self._send(Release(held.drag.body))
