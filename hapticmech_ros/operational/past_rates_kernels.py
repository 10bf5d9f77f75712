# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Parts of kernels: rates of a mechanism's last states, by their stamps."""

from __future__ import annotations

from hapticmech_ros.arrays import Array
from hapticmech_ros.compilation import inner, put

# Of the numbers that go with the states: how many states there are, the row of the newest one, how
# long before a state the rates are wanted, ns, and by how much that may be missed to either side.
COUNT, NEWEST, WANTED, MISSING, FARTHEST = range(5)
PAST_SIZE = 5


@inner
def rates_before(past: Array, stamps: Array, rates: Array, stamp: int, before: Array) -> None:
    """Fill (1 + nv,) how long before a time, s, and the rates that were; zeros if unknown.

    Args:
        past: (5,) whole numbers, see above.
        stamps: (states,) ns.
        rates: (states, nv) rad/s or m/s.
        stamp: the time, ns.
        before: (1 + nv,) to fill.
    """
    before[:] = 0.0
    for back in range(past[COUNT]):
        row = (past[NEWEST] - back) % stamps.size
        age = stamp - stamps[row]
        if age > past[FARTHEST]:
            return
        if age >= past[WANTED] - past[MISSING]:
            before[0] = age / 1e9
            put(before[1:], rates[row])
            return


@inner
def remember_state(past: Array, stamps: Array, rates: Array, stamp: int, v: Array) -> None:
    """Remember the rates of a state.

    Args:
        past: (5,) whole numbers, changed.
        stamps: (states,) ns, changed.
        rates: (states, nv) rad/s or m/s, changed.
        stamp: of the state, ns; not before that of the one before, or those are forgotten.
        v: (nv,) its rates.
    """
    if past[COUNT] > 0 and stamp < stamps[past[NEWEST]]:
        past[COUNT] = 0
    if past[WANTED] == 0:
        return
    past[NEWEST] = (past[NEWEST] + 1) % stamps.size
    past[COUNT] = min(past[COUNT] + 1, stamps.size)
    stamps[past[NEWEST]] = stamp
    put(rates[past[NEWEST]], v)
