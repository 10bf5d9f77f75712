# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What a process holds, and whether that grows."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
import psutil
from scipy.stats import theilslopes

from benchmarks.children import BenchError

# Before that caches fill, and allocators take what they will keep.
WARM_UP_SHARE, LEAST_SAMPLES = 0.25, 8


class Usage(NamedTuple):
    """Of one process at one time.

    Attributes:
        resident: pages in memory, shared ones included, bytes.
        proportional: the same, a page that n processes share counted by an n-th, bytes.
        descriptors, threads: how many.
    """

    resident: float
    proportional: float
    descriptors: float
    threads: float


def usage(pid: int) -> Usage:
    """Return what a process holds now.

    Raises:
        BenchError: there is no such process any more.
    """
    try:
        process = psutil.Process(pid)
        memory = process.memory_full_info()
        return Usage(memory.rss, memory.pss, process.num_fds(), process.num_threads())
    except psutil.NoSuchProcess:
        raise BenchError(f"process {pid} ended by itself") from None


def resident(pid: int) -> float:
    """Return how much of a process is in memory, bytes; NaN if it is no more."""
    try:
        return float(psutil.Process(pid).memory_info().rss) or math.nan
    except psutil.NoSuchProcess:
        return math.nan


def blocks(values: Sequence[float], most: int) -> npt.NDArray[np.float64]:
    """Return medians of successive parts (n,), of which there are ``most`` where values suffice.

    All pairs of 100,000 samples would be too many for :func:`grown`.
    """
    parts = np.array_split(np.asarray(values, dtype=float), min(most, len(values)) or 1)
    return np.array([float(np.median(part)) for part in parts if part.size])


def grown(times: Sequence[float], values: Sequence[float]) -> float:
    """Return by how much something grew after the warm-up: its slope, times the time.

    The slope is the median of those between all pairs of samples (Theil and Sen), which single
    samples however far off do not move.

    Args:
        times: (n,) s, rising.
        values: (n,) of any unit.

    Raises:
        BenchError: fewer than 8 samples after the warm-up.
    """
    at, found = np.asarray(times, dtype=float), np.asarray(values, dtype=float)
    after = at >= at[0] + WARM_UP_SHARE * (at[-1] - at[0])
    at, found = at[after], found[after]
    if at.size < LEAST_SAMPLES:
        raise BenchError(f"{at.size} samples: {LEAST_SAMPLES} or more are needed to see a trend")
    return float(theilslopes(found, at)[0] * (at[-1] - at[0]))
