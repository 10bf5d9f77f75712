# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Memory of processes over time: samples, and what they say."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from benchmarks.machine import PROC
from hapticmech_ros.errors import InvalidInputError

_RSS = re.compile(r"^VmRSS:\s+(\d+) kB$", re.MULTILINE)
_DIRTY = re.compile(r"^Private_Dirty:\s+(\d+) kB$", re.MULTILINE)
_KILO = 1024
# Before that caches fill, and allocators take what they will keep.
WARM_UP_SHARE = 0.25
LEAST_SAMPLES = 8
HOUR = 3600.0
# A slope counts from so many of its standard errors on, and from so many bytes in an hour: 256
# pages of 4 KiB. What leaks 8 bytes in each tick at 1 kHz grows by 29 MB.
ERRORS, GROWTH_IN_AN_HOUR = 3.0, float(1 << 20)


@dataclass(slots=True)
class Watch:
    """Samples of some processes.

    Attributes:
        times: s since the first sample.
        resident: by process, bytes at these times.
        private: the same of pages that it alone has and has written to; NaN where unknown.
    """

    times: list[float] = field(default_factory=list)
    resident: dict[str, list[float]] = field(default_factory=dict)
    private: dict[str, list[float]] = field(default_factory=dict)

    def look(self, time: float, processes: Mapping[str, int]) -> bool:
        """Take a sample of processes by name (ids); False, and nothing, if one is no more."""
        found = {name: resident(pid) for name, pid in processes.items()}
        if None in found.values():
            return False
        self.times.append(time)
        for name, size in found.items():
            if size is not None:
                self.resident.setdefault(name, []).append(size.resident)
                self.private.setdefault(name, []).append(size.private)
        return True

    def trends(self, warm_up: float) -> dict[str, Trend]:
        """Return the trend of each process's resident size.

        Raises:
            InvalidInputError: too few samples.
        """
        return {name: trend(self.times, sizes, warm_up) for name, sizes in self.resident.items()}


@dataclass(frozen=True, slots=True)
class Grown:
    """What was seen of one process.

    Attributes:
        where: ``session`` or ``graph``.
        name: of the process.
        ticks: that it did, about; of nodes, periods.
        trend: of its resident size.
        private_first, private_last: pages that it alone wrote to, bytes, after the warm-up and at
            the end; None where the kernel does not tell.
    """

    where: str
    name: str
    ticks: int
    trend: Trend
    private_first: float | None
    private_last: float | None


def grown(where: str, watch: Watch, ticks: int, warm_up: float) -> tuple[Grown, ...]:
    """Return what was seen of each process of a watch."""
    return tuple(
        Grown(
            where,
            name,
            ticks,
            found,
            _known(watch.private[name][-found.samples]),
            _known(watch.private[name][-1]),
        )
        for name, found in watch.trends(warm_up).items()
    )


def _known(size: float) -> float | None:
    return None if size != size else size


class Resident(NamedTuple):
    """Memory of a process at one time, bytes.

    Attributes:
        resident: VmRSS, all pages that are in memory, shared ones included.
        private: pages that it alone has and has written to; NaN where the kernel does not tell.
    """

    resident: float
    private: float


def resident(pid: int) -> Resident | None:
    """Return the memory of a process now; None if there is no such process any more."""
    try:
        status = (PROC / str(pid) / "status").read_text(encoding="utf-8")
    except (FileNotFoundError, ProcessLookupError):
        return None
    size = _RSS.search(status)
    if size is None:  # It has ended, and waits for its parent.
        return None
    try:
        rollup = (PROC / str(pid) / "smaps_rollup").read_text(encoding="utf-8")
    except OSError:  # Older kernels have no such file; others' processes do not show theirs.
        rollup = ""
    dirty = _DIRTY.search(rollup)
    return Resident(
        float(_KILO * int(size[1])), float("nan") if dirty is None else float(_KILO * int(dirty[1]))
    )


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
