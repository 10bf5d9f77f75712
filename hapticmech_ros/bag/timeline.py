# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The clock of a replay: which bag time it is, at which rate, and whether it stands still."""

from __future__ import annotations

from hapticmech_ros.errors import InvalidInputError


class Timeline:
    """Maps a steady clock to the time of a bag and back; both in ns.

    Deadlines are absolute: whatever is late does not delay what comes after it.

    Args:
        bag_ns: time of the bag at the beginning.
        now_ns: steady time then.
        rate: bag seconds per second.

    Raises:
        InvalidInputError: a rate that is not positive.
    """

    def __init__(self, bag_ns: int, now_ns: int, rate: float = 1.0, paused: bool = False) -> None:
        if not rate > 0.0:
            raise InvalidInputError("rate", rate, "must be positive")
        self._rate = rate
        self._bag_ns, self._from_ns = bag_ns, now_ns
        self.paused = paused

    def bag_ns(self, now_ns: int) -> int:
        """Return the bag's time."""
        if self.paused:
            return self._bag_ns
        return self._bag_ns + round((now_ns - self._from_ns) * self._rate)

    def deadline_ns(self, bag_ns: int) -> int:
        """Return when a time of the bag comes, if nobody pauses."""
        return self._from_ns + round((bag_ns - self._bag_ns) / self._rate)

    def pause(self, now_ns: int) -> None:
        """Stand still."""
        self._bag_ns = self.bag_ns(now_ns)
        self.paused = True

    def resume(self, now_ns: int) -> None:
        """Go on from where it stands."""
        if self.paused:
            self._from_ns = now_ns
            self.paused = False
