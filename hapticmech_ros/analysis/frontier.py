# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Search for a stability limit by bisection on a logarithmic scale."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from hapticmech_ros.errors import InvalidInputError

# Relative resolution for sessions, and for eigenvalues.
RESOLUTION, FINE = 0.01, 1e-4


def frontier(
    stable: Callable[[float], bool],
    guess: float,
    least: float,
    most: float,
    resolution: float = RESOLUTION,
) -> float | None:
    """Return the largest stable value; None if ``least`` is not stable.

    The search goes outward from a guess until a stable and an unstable value are found, and bisects
    between them. If there is only one limit, the result does not depend on the guess.

    Args:
        stable: returns whether a positive value is stable.
        guess: first value to try.
        least: lower end of the search.
        most: upper end; returned if it is stable.
        resolution: relative resolution of the result.

    Raises:
        InvalidInputError: bounds that are not 0 < least < most.
    """
    if not 0.0 < least < most:
        raise InvalidInputError("bounds", (least, most), "must be positive and in order")
    low = high = float(np.clip(guess, least, most))
    step = 1.3
    if stable(low):
        while True:
            if low >= most:
                return most
            high = min(step * low, most)
            if not stable(high):
                break
            low, step = high, step**2
    else:
        while True:
            if high <= least:
                return None
            low = max(high / step, least)
            if stable(low):
                break
            high, step = low, step**2
    while high > (1.0 + resolution) * low:
        middle = float(np.sqrt(low * high))
        low, high = (middle, high) if stable(middle) else (low, middle)
    return low
