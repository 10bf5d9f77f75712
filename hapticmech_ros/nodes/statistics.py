# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Counts and percentiles that cost next to nothing per message: a histogram of durations."""

from __future__ import annotations

import os
import time
from array import array

import numpy as np

BIN_NS = 10_000
BINS = 20_000


class DurationHistogram:
    """Durations in bins of 10 µs up to 200 ms; longer ones are in the last bin."""

    def __init__(self) -> None:
        self._counts = array("q", bytes(8 * BINS))
        self.count = 0
        self.max_ns = 0

    def add(self, duration_ns: int) -> None:
        """Count one duration; negative ones count as zero."""
        index = min(max(duration_ns, 0) // BIN_NS, BINS - 1)
        self._counts[index] += 1
        self.count += 1
        self.max_ns = max(self.max_ns, duration_ns)

    def percentiles_us(self, *shares: float) -> tuple[float, ...]:
        """Return percentiles (0 to 100) in µs, upper edge of the bin; 0 if nothing was counted."""
        if self.count == 0:
            return (0.0,) * len(shares)
        totals = np.cumsum(np.frombuffer(self._counts, dtype=np.int64))
        needed = [np.ceil(share / 100.0 * self.count) for share in shares]
        indices = [int(np.searchsorted(totals, max(need, 1.0))) for need in needed]
        return tuple((index + 1) * BIN_NS / 1000.0 for index in indices)

    def summary(self, name: str) -> dict[str, str]:
        """Return the figures for diagnostics, keys ``<name>_p50_us`` and so on."""
        p50, p90, p99 = self.percentiles_us(50.0, 90.0, 99.0)
        return {
            f"{name}_count": str(self.count),
            f"{name}_p50_us": f"{p50:.0f}",
            f"{name}_p90_us": f"{p90:.0f}",
            f"{name}_p99_us": f"{p99:.0f}",
            f"{name}_max_us": f"{self.max_ns / 1000.0:.0f}",
        }


def processor_time() -> dict[str, str]:
    """Return for diagnostics which process this is, and what it took of the processors until now.

    Returns:
        Its number, its processor time, s, and the time of the machine's monotonic clock, s.
    """
    return {
        "pid": str(os.getpid()),
        "cpu_s": f"{time.process_time():.4f}",
        "monotonic_s": f"{time.monotonic():.4f}",
    }
