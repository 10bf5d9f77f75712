"""Where stable ends: bisection on a logarithmic scale."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from hapticmech_ros.errors import InvalidInputError

# Relative: of sessions, finer than gains are ever chosen; of eigenvalues.
RESOLUTION, FINE = 0.01, 1e-4


def frontier(
    stable: Callable[[float], bool],
    guess: float,
    least: float,
    most: float,
    resolution: float = RESOLUTION,
) -> float | None:
    """Return the largest value that is stable; None if not even ``least`` is.

    Looks outward from a guess until one value is stable and another one is not, then between them.
    What it returns does not depend on the guess where there is one frontier only.

    Args:
        stable: whether a value is; called with positive values.
        guess: where to look first.
        least: where to give up.
        most: likewise; returned if it is stable itself.
        resolution: relative, of what is returned.

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
