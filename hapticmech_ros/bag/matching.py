# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Pairs the messages of two recordings of one topic."""

from __future__ import annotations

from collections import defaultdict, deque
from collections.abc import Sequence

import numpy as np

Pairs = list[tuple[int, int]]


def by_order(a: int, b: int) -> Pairs:
    """Return the pairs of two recordings with ``a`` and ``b`` messages: first with first."""
    return [(i, i) for i in range(min(a, b))]


def by_stamp(a: Sequence[int], b: Sequence[int]) -> Pairs:
    """Return pairs of equal stamps; of several with the same stamp first with first."""
    places: dict[int, deque[int]] = defaultdict(deque)
    for index, stamp in enumerate(b):
        places[stamp].append(index)
    return [(i, places[stamp].popleft()) for i, stamp in enumerate(a) if places.get(stamp)]


def by_nearest(a: Sequence[int], b: Sequence[int]) -> Pairs:
    """Return pairs of nearest stamps, no further apart than half the median period of ``a``.

    For runs whose clocks have nothing to do with each other. No message is in two pairs.
    """
    if not a or not b:
        return []
    left, right = np.asarray(a), np.asarray(b)
    a_order, b_order = np.argsort(left, kind="stable"), np.argsort(right, kind="stable")
    left, right = left[a_order], right[b_order]
    reach = float(np.median(np.diff(left))) / 2 if left.size > 1 else 0.0
    pairs: Pairs = []
    free = 0
    for index, stamp in enumerate(left):
        at = max(int(np.searchsorted(right, stamp)), free)
        near = [k for k in (at - 1, at) if free <= k < right.size]
        best = min(near, key=lambda k: abs(int(right[k]) - int(stamp)), default=None)
        if best is not None and abs(int(right[best]) - int(stamp)) <= reach:
            pairs.append((int(a_order[index]), int(b_order[best])))
            free = best + 1
    return sorted(pairs)
