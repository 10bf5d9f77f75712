# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Where an actor that moves something goes back to when its state is none any more."""

from __future__ import annotations

from collections.abc import Callable
from typing import Generic, TypeVar

from hapticmech_ros.times import NANOSECONDS

T = TypeVar("T")
# Who fails again so soon goes back to where it began, s.
CALM_S = 0.25
# How long one that failed is silent, so that everyone notices, before it goes on at rest.
SILENCE_NS = NANOSECONDS // 2


class LastValidState(Generic[T]):
    """The last state in which all was well, and the one to begin with where even that fails.

    Args:
        start: the state to begin with.
        period_s: between two ticks.

    Attributes:
        resting: whether it is silent now, after a failure.
    """

    def __init__(self, start: T, period_s: float) -> None:
        self._start = self._good = start
        self._since = self._calm = max(1, round(CALM_S / period_s))
        self._until_ns = 0
        self.resting = False

    def keep(self, state: T, ticks: int = 1) -> None:
        """Remember a state that was sent to others, and those before it: they kept every rule."""
        self._good = state
        self._since += ticks

    def go_back(self, now_ns: int) -> T:
        """Return the last state that was well; the start, if it was gone back to just now."""
        if self._since < self._calm:
            self._good = self._start
        self._since = 0
        self._until_ns, self.resting = now_ns + SILENCE_NS, True
        return self._good

    def rests(self, now_ns: int, begin: Callable[[], None]) -> bool:
        """Return whether it is silent at a time; call ``begin`` when that is over.

        What was heard meanwhile was for one that was not there, and counts no more.
        """
        # Time that was set back meanwhile prolongs nothing.
        if self.resting and not self._until_ns - SILENCE_NS <= now_ns < self._until_ns:
            self.resting = False
            begin()
        return self.resting
