# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What a process holds, as Linux tells in /proc, and whether that grows."""

from __future__ import annotations

import os
import re
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from benchmarks.children import BenchError
from benchmarks.memory.growth import LEAST_SAMPLES, WARM_UP_SHARE

PROC = Path("/proc")
KILO = 1024
TICKS_PER_S = os.sysconf("SC_CLK_TCK")
_RSS = re.compile(r"^VmRSS:\s+(\d+) kB$", re.MULTILINE)
_THREADS = re.compile(r"^Threads:\s+(\d+)$", re.MULTILINE)
_PSS = re.compile(r"^Pss:\s+(\d+) kB$", re.MULTILINE)


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
        status = (PROC / str(pid) / "status").read_text("utf-8")
        rollup = (PROC / str(pid) / "smaps_rollup").read_text("utf-8")
        descriptors = sum(1 for _ in (PROC / str(pid) / "fd").iterdir())
    except (FileNotFoundError, ProcessLookupError):
        raise BenchError(f"process {pid} ended by itself") from None
    resident, threads, shares = (
        pattern.search(text)
        for pattern, text in ((_RSS, status), (_THREADS, status), (_PSS, rollup))
    )
    if resident is None or threads is None or shares is None:
        raise BenchError(f"process {pid} ended by itself")
    sizes = float(KILO * int(resident[1])), float(KILO * int(shares[1]))
    return Usage(*sizes, float(descriptors), float(threads[1]))


def processor_s(pid: int) -> float:
    """Return how much time of processors a process has taken, s.

    Raises:
        BenchError: there is no such process any more.
    """
    try:
        said = (PROC / str(pid) / "stat").read_text("utf-8")
    except (FileNotFoundError, ProcessLookupError):
        raise BenchError(f"process {pid} ended by itself") from None
    # Behind the name, which may hold anything: the 14th and 15th of all.
    user, system = said.rpartition(")")[2].split()[11:13]
    return (int(user) + int(system)) / TICKS_PER_S


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
    at, found = np.asarray(times), np.asarray(values)
    after = at >= at[0] + WARM_UP_SHARE * (at[-1] - at[0])
    at, found = at[after], found[after]
    if at.size < LEAST_SAMPLES:
        raise BenchError(f"{at.size} samples: {LEAST_SAMPLES} or more are needed to see a trend")
    first, second = np.triu_indices(at.size, 1)
    slopes = (found[second] - found[first]) / (at[second] - at[first])
    return float(np.median(slopes) * (at[-1] - at[0]))
