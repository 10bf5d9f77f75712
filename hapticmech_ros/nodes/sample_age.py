# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""How old a device's samples are on arrival, without comparing two hosts' clocks.

What a stamp lacks to the time of arrival is the way here and the difference of the two clocks. The
least of it lately is the quickest way with the same difference: what a sample lacks beyond that is
how much longer it took.
"""

from __future__ import annotations

import time

from hapticmech_ros.errors import InvalidInputError
from hapticmech_ros.nodes.inputs import NEVER
from hapticmech_ros.times import NANOSECONDS

# Over so long, and the span before it: clocks drift by microseconds meanwhile.
SPAN_NS = 10 * NANOSECONDS


class SampleAge:
    """Judges samples of a device, in order, by how much longer than the quickest they took."""

    def __init__(self) -> None:
        self.forget()

    def forget(self) -> None:
        """Begin anew: the sender's clock may be another one."""
        self._least_ns: int | None = None
        self._next_ns: int | None = None
        self._since_ns = self._stamp_ns = NEVER

    def check(self, stamp_ns: int, limit_ns: int) -> None:
        """Refuse a sample that is too old.

        Args:
            stamp_ns: of the sample; one before the last says that the sender's clock was set.
            limit_ns: how old it may be.

        Raises:
            InvalidInputError: it is older.
        """
        beyond_ns = self.beyond(stamp_ns)
        if beyond_ns > limit_ns:
            rule = f"must be within {limit_ns / NANOSECONDS:g} s of the quickest one's"
            raise InvalidInputError("age of sample, s", beyond_ns / NANOSECONDS, rule)

    def beyond(self, stamp_ns: int) -> int:
        """Return by how much longer, ns, a sample that comes now took than the quickest one.

        Args:
            stamp_ns: of the sample; one before the last says that the sender's clock was set.
        """
        if stamp_ns < self._stamp_ns:
            self.forget()
        self._stamp_ns = stamp_ns
        # Any clock does that nobody sets.
        arrived_ns = time.monotonic_ns()
        lacks = arrived_ns - stamp_ns
        if self._next_ns is None or arrived_ns - self._since_ns > SPAN_NS:
            self._least_ns, self._next_ns, self._since_ns = self._next_ns, lacks, arrived_ns
        self._next_ns = min(self._next_ns, lacks)
        least = self._next_ns if self._least_ns is None else min(self._least_ns, self._next_ns)
        return lacks - least
