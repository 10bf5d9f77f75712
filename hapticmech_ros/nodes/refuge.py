"""Where an actor that moves something goes back to when its state is none any more."""

from __future__ import annotations

from typing import Generic, TypeVar

T = TypeVar("T")
# Who fails again so soon goes back to where it began, s.
CALM_S = 0.25


class Refuge(Generic[T]):
    """The last state in which all was well, and the one to begin with where even that fails.

    Args:
        start: the state to begin with.
        period_s: between two ticks.
    """

    def __init__(self, start: T, period_s: float) -> None:
        self._start = self._good = start
        self._since = self._calm = max(1, round(CALM_S / period_s))

    def keep(self, state: T) -> None:
        """Remember a state that was sent to others: it kept every rule."""
        self._good = state
        self._since += 1

    def go_back(self) -> T:
        """Return the last state that was well; the start, if it was gone back to just now."""
        if self._since < self._calm:
            self._good = self._start
        self._since = 0
        return self._good
