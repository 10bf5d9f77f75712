# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A node's time by the machine's clock: ROS time for stamps that never goes back by itself.

Deadlines, freshness and timeouts must not follow a clock that somebody sets. So the time of a node
is the monotonic clock plus a constant, which makes it ROS time. NTP slews both clocks alike, and
the constant stays right; when the machine's clock is *set*, or the machine has slept, it is wrong
from then on. That is an event: the constant is measured anew, and the node begins anew.
"""

from __future__ import annotations

import time

from hapticmech_ros.times import NANOSECONDS

# A smaller step changes nothing that is felt: poses are carried on over no more than this.
STEP_NS = 5_000_000
# Reads of both clocks, of which the closest pair counts: a process may be interrupted between two.
_READS = 5


class NodeTime:
    """ROS time that goes on evenly, and notices when the machine's clock was set.

    Attributes:
        steps: how often the machine's clock was set since the start.
    """

    def __init__(self) -> None:
        self.steps = 0
        self._ahead_ns = _wall_ahead_ns()

    def now_ns(self) -> int:
        """Return the time, ns since the epoch."""
        return time.monotonic_ns() + self._ahead_ns

    def step_ns(self) -> int:
        """Return by how much the machine's clock was set since it was asked last, ns; else 0.

        From then on time follows the clock as it was set.
        """
        apart = time.time_ns() - time.monotonic_ns() - self._ahead_ns
        if -STEP_NS <= apart <= STEP_NS:
            return 0
        ahead = _wall_ahead_ns()
        apart = ahead - self._ahead_ns
        if -STEP_NS <= apart <= STEP_NS:
            # Interrupted between the two reads.
            return 0
        self._ahead_ns = ahead
        self.steps += 1
        return apart


def said_of_step(step_ns: int) -> str:
    """Return a sentence on a step of a clock, ns."""
    way = "forward" if step_ns > 0 else "back"
    return f"clock set {way} by {abs(step_ns) / NANOSECONDS:.3g} s"


def _wall_ahead_ns() -> int:
    """Return how far the machine's clock is ahead of the monotonic one, ns."""
    best, narrowest = 0, 1 << 62
    for _ in range(_READS):
        before = time.monotonic_ns()
        wall = time.time_ns()
        width = time.monotonic_ns() - before
        if width < narrowest:
            narrowest, best = width, wall - before - width // 2
    return best
