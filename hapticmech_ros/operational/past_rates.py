# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Rates of a mechanism's last states, for the delay compensation of the next one."""

from __future__ import annotations

import numpy as np

from hapticmech_ros.arrays import Array
from hapticmech_ros.mechanism.closures import Active
from hapticmech_ros.operational.past_rates_kernels import (
    COUNT,
    PAST_SIZE,
    WANTED,
    rates_before,
    remember_state,
)

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

    Attributes:
        arrays: for kernels; see :mod:`.past_rates_kernels`.
    """

    def __init__(self, periods: int, period_ns: int, size: int) -> None:
        remembered = round(FARTHEST * periods) + 2
        numbers = np.zeros(PAST_SIZE, dtype=np.int64)
        wanted = periods * period_ns
        numbers[WANTED:] = wanted, round(MISSING * period_ns), round(FARTHEST * wanted)
        self.arrays: tuple[Array, Array, Array] = (
            numbers,
            np.zeros(remembered, dtype=np.int64),
            np.zeros((remembered, size)),
        )
        self._active: Active | None = None

    def forget(self) -> None:
        """Forget all states: the mechanism may be elsewhere."""
        self.arrays[0][COUNT] = 0

    def add(self, stamp_ns: int, rates: Array, active: Active) -> None:
        """Remember a state.

        Args:
            stamp_ns: its time, ns; not before that of the one before, or those are forgotten.
            rates: (nv,) rad/s or m/s.
            active: which closures are closed; if others than before, those before are forgotten.
        """
        if active != self._active:
            self.forget()
            self._active = active
        remember_state(*self.arrays, stamp_ns, rates)

    def before(self, stamp_ns: int, active: Active) -> Array:
        """Return (1 + nv,) how long before a time, s, and the rates that were.

        They are the newest ones of so many periods ago or longer, of the same closures; zeros where
        there are none.

        Args:
            stamp_ns: the time, ns.
            active: which closures are closed then.
        """
        found = np.zeros(1 + self.arrays[2].shape[1])
        if active == self._active:
            rates_before(*self.arrays, stamp_ns, found)
        return found
