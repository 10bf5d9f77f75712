"""Whether a size grows: the slope of samples, and what it comes to in an hour."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from hapticmech_ros.errors import InvalidInputError

# Before that caches fill, and allocators take what they will keep.
WARM_UP_SHARE = 0.25
LEAST_SAMPLES = 8
HOUR = 3600.0
# A slope counts from so many of its standard errors on, and from so many bytes in an hour: 256
# pages of 4 KiB. What leaks 8 bytes in each tick at 1 kHz grows by 29 MB.
ERRORS, GROWTH_IN_AN_HOUR = 3.0, float(1 << 20)


@dataclass(frozen=True, slots=True)
class Trend:
    """Growth of a size after the warm-up.

    Attributes:
        samples: that were looked at.
        duration: from the first to the last of them, s.
        first, last, largest: of these, bytes.
        slope: least squares, bytes/s.
        slope_error: its standard error, bytes/s, of samples that do not depend on each other.
    """

    samples: int
    duration: float
    first: float
    last: float
    largest: float
    slope: float
    slope_error: float

    @property
    def per_hour(self) -> float:
        """Growth in an hour, bytes."""
        return self.slope * HOUR

    @property
    def flat(self) -> bool:
        """Whether it does not grow."""
        seen = self.slope > ERRORS * self.slope_error
        return not (seen and self.per_hour > GROWTH_IN_AN_HOUR)

    @property
    def verdict(self) -> str:
        """``flat``, or by how much it grows."""
        return "flat" if self.flat else f"grows by {self.per_hour / (1 << 20):.1f} MiB an hour"


def trend(times: npt.ArrayLike, sizes: npt.ArrayLike, warm_up: float = WARM_UP_SHARE) -> Trend:
    """Return how a size grows.

    Args:
        times: (n,) s, rising.
        sizes: (n,) bytes.
        warm_up: share of the time, from the start, that is left out.

    Raises:
        InvalidInputError: not as many times as sizes, or fewer than 8 samples after the warm-up.
    """
    at, found = np.asarray(times, dtype=float), np.asarray(sizes, dtype=float)
    if at.ndim != 1 or at.shape != found.shape:
        raise InvalidInputError("sizes", found.shape, f"must be as many as times, {at.shape}")
    if at.size:
        after = at >= at[0] + warm_up * (at[-1] - at[0])
        at, found = at[after], found[after]
    if at.size < LEAST_SAMPLES:
        rule = f"must be {LEAST_SAMPLES} or more: look longer, or more often"
        raise InvalidInputError("samples after the warm-up", at.size, rule)
    shifted = at - at.mean()
    spread = float(shifted @ shifted)
    slope = float(shifted @ found) / spread
    rest = found - found.mean() - slope * shifted
    error = math.sqrt(float(rest @ rest) / (at.size - 2) / spread)
    ends = float(found[0]), float(found[-1]), float(found.max())
    return Trend(at.size, float(at[-1] - at[0]), *ends, slope, error)
