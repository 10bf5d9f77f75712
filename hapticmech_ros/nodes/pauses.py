# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""When a process had no processor: by its own clocks, and what a sender's messages show of that.

A process that wanted to wait until a deadline at the longest, and went on later, without having
computed meanwhile, had none: others had them all, or it was stopped. Of a sender its messages show
that it paused; why is not to be seen in them.
"""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable

from hapticmech_ros.nodes.inputs import NEVER
from hapticmech_ros.nodes.lane_kernels import SHORTEST_PAUSE_NS
from hapticmech_ros.nodes.sources import Origin
from hapticmech_ros.times import NANOSECONDS

_REMEMBERED = 16
MINUTE_NS = 60 * NANOSECONDS
# So many losses within a minute that pauses explain are no accident: the machine is too slow.
SEVERAL = 3


class Pauses:
    """Pauses of a process.

    Attributes:
        looked_ns: when it was looked at last, ns.
    """

    def __init__(self) -> None:
        self.looked_ns = NEVER
        self._found: deque[tuple[int, int]] = deque(maxlen=_REMEMBERED)

    def within(self, time_ns: int) -> tuple[int, int]:
        """Return how long it paused, ns, within a time up to the last look, ns.

        Returns:
            As far as that lies within, and how long these pauses were as a whole.
        """
        start = self.looked_ns - time_ns
        found = [(length, end - start) for end, length in self._found if end > start]
        return sum(map(min, found)), sum(length for length, _ in found)

    def _note(self, length_ns: int) -> None:
        """Note a pause up to now."""
        if length_ns > SHORTEST_PAUSE_NS:
            self._found.append((self.looked_ns, length_ns))


class Remedy:
    """Says what helps where pauses are no accident; once a minute in a process."""

    def __init__(self) -> None:
        self._lately: deque[tuple[int, int]] = deque(maxlen=1000)
        self._said_ns: int | None = None

    def after(self, length_ns: int, rate_hz: float, now_ns: int) -> str:
        """Return what to say after a loss that a pause explains; mostly nothing.

        Args:
            length_ns: of the pause, ns.
            rate_hz: the control rate, Hz.
            now_ns: present time, ns.
        """
        lately = self._lately
        lately.append((now_ns, length_ns))
        while now_ns - lately[0][0] > MINUTE_NS:
            lately.popleft()
        said = self._said_ns
        if len(lately) < SEVERAL or (said is not None and now_ns - said < MINUTE_NS):
            return ""
        self._said_ns = now_ns
        longest_ms = max(length for _, length in lately) / 1e6
        return (
            f"within a minute rendering ended {len(lately)} times because a process paused, for up "
            f"to {longest_ms:.0f} ms: this machine does not carry this rate ({rate_hz:g} Hz): "
            "see docs/realtime.md"
        )


class OwnPauses(Pauses):
    """Those of this process, in which it wanted to go on and had no processor.

    Args:
        clock_ns: returns the time, ns.
        computed_ns: returns for how long this thread has computed, ns.

    Attributes:
        remedy: says what helps.
        waits: return how long each node would still wait now, ns, less than nothing if it wanted to
            go on before; None: for ever.
    """

    def __init__(
        self,
        clock_ns: Callable[[], int] = time.monotonic_ns,
        computed_ns: Callable[[], int] = time.thread_time_ns,
    ) -> None:
        super().__init__()
        self.remedy = Remedy()
        self.waits: list[Callable[[], int | None]] = []
        self._clock_ns, self._computed_ns = clock_ns, computed_ns
        self._computed = 0

    def look(self) -> None:
        """Note that the process goes on; asked for with every message and deadline, before it."""
        before, computed = self.looked_ns, self._computed
        self.looked_ns = now = self._clock_ns()
        self._computed = self._computed_ns()
        if before == NEVER or now - before <= SHORTEST_PAUSE_NS:
            return
        waits = [wait for ask in self.waits if (wait := ask()) is not None]
        if waits:
            wanted = min(now - before, -min(waits))
            self._note(wanted - (self._computed - computed))


class SenderPauses(Pauses):
    """Those of a sender of stamps on a grid of periods: stamps that go on faster than their count.

    Args:
        name: of the sender, in words.
        period_ns: of its messages.
    """

    def __init__(self, name: str, period_ns: int) -> None:
        super().__init__()
        self.name = name
        self._period_ns = period_ns
        self._via = self._count = self._stamp_ns = 0

    @property
    def last(self) -> tuple[int, int, int]:
        """Of the last message its publisher, its number, and its stamp, ns."""
        return self._via, self._count, self._stamp_ns

    def received(self, stamp_ns: int, origin: Origin, now_ns: int) -> None:
        """Note a message.

        Args:
            stamp_ns: its stamp, ns.
            origin: whom it comes from, and by which number.
            now_ns: time of its arrival, ns.
        """
        count = origin.sent or origin.number
        periods = count - self._count
        before_ns, anew = self._stamp_ns, origin.via != self._via
        self.went_on(stamp_ns, origin, now_ns)
        if count and periods > 0 and not anew:
            self._note(stamp_ns - before_ns - periods * self._period_ns)

    def went_on(self, stamp_ns: int, origin: Origin, now_ns: int) -> None:
        """Note a message before which there was no pause; arguments as of :meth:`heard`."""
        self.looked_ns = now_ns
        self._via, self._count = origin.via, origin.sent or origin.number
        self._stamp_ns = stamp_ns
