# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Closures that close by themselves: when one does, and when one that was opened may again."""

from __future__ import annotations

from collections.abc import Iterable

from hapticmech_ros.arrays import Array
from hapticmech_ros.mechanism.closures import Active
from hapticmech_ros.mechanism.mechanism import Mechanism

# Of the distance within which a closure latches: nearer than this it does not wait any longer.
AT_ONCE = 0.1


class Latches:
    """The closures of a mechanism that latch: within reach, where their frames come nearest.

    One that was opened there is released: it does not latch again before it has left its reach.

    Args:
        mechanism: whose.
    """

    def __init__(self, mechanism: Mechanism) -> None:
        self._mechanism = mechanism
        self._limits = {
            index: loop.latch_distance
            for index, loop in enumerate(mechanism.closures)
            if loop.latch_distance
        }

    def waiting(self, active: Active) -> bool:
        """Return whether one is open."""
        return not all(active[index] for index in self._limits)

    def after(
        self, q: Array, v: Array, active: Active, released: Iterable[int]
    ) -> tuple[Active, frozenset[int]]:
        """Return which closures are closed at (q, v), and which of the others are released.

        Args:
            q: (nq,) configuration.
            v: (nv,) rates, rad/s or m/s.
            active: per closure, whether it is closed.
            released: indices of those that were opened, and have not left their reach since.
        """
        closed, still = list(active), set(released)
        for index, limit in self._limits.items():
            if not closed[index]:
                distance, speed = self._mechanism.distance_of(index, q, v)
                if distance >= limit:
                    still.discard(index)
                elif index not in still and (speed >= 0.0 or distance < AT_ONCE * limit):
                    closed[index] = not self._mechanism.on_wrong_branch(index, q)
        return tuple(closed), frozenset(still)
