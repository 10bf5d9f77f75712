# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Rates of a mechanism's last states, for the delay compensation of the next one."""

from __future__ import annotations

from collections import deque

import numpy as np

from hapticmech_ros.arrays import Array
from hapticmech_ros.mechanism.closures import Active
from hapticmech_ros.times import NANOSECONDS

# Rates as much longer ago than wanted, in periods wanted, say nothing of now; and so much of a
# period may be missing.
FARTHEST, MISSING = 2.0, 0.25


class PastRates:
    """Remembers rates, and tells those of a number of periods ago.

    Args:
        periods: how many, see :func:`~hapticmech_ros.control.compensated_delay.periods_before`; 0
            if none are ever wanted.
        period_ns: T, ns.
        size: nv.
    """

    def __init__(self, periods: int, period_ns: int, size: int) -> None:
        self._wanted_ns, self._missing_ns = periods * period_ns, round(MISSING * period_ns)
        remembered = round(FARTHEST * periods) + 2
        self._states: deque[tuple[int, Array, Active]] = deque(maxlen=remembered)
        self._unknown = np.zeros(1 + size)

    def forget(self) -> None:
        """Forget all states: the mechanism may be elsewhere."""
        self._states.clear()

    def add(self, stamp_ns: int, rates: Array, active: Active) -> None:
        """Remember a state.

        Args:
            stamp_ns: its time, ns; not before that of the one before, or those are forgotten.
            rates: (nv,) rad/s or m/s.
            active: which closures are closed.
        """
        if self._states and stamp_ns < self._states[-1][0]:
            self._states.clear()
        if self._wanted_ns:
            self._states.append((stamp_ns, rates.copy(), active))

    def before(self, stamp_ns: int, active: Active) -> Array:
        """Return (1 + nv,) how long before a time, s, and the rates that were.

        They are the newest ones of so many periods ago or longer, of the same closures; zeros where
        there are none.

        Args:
            stamp_ns: the time, ns.
            active: which closures are closed then.
        """
        for known_ns, rates, closed in reversed(self._states):
            age_ns = stamp_ns - known_ns
            if closed != active or age_ns > FARTHEST * self._wanted_ns:
                break
            if age_ns >= self._wanted_ns - self._missing_ns:
                return np.concatenate(((age_ns / NANOSECONDS,), rates))
        return self._unknown
