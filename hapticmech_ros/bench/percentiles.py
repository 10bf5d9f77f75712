"""Percentiles of latencies, of one run and of several."""

from __future__ import annotations

import statistics
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields

import numpy as np

from hapticmech_ros.arrays import Array


@dataclass(frozen=True, slots=True)
class Percentiles:
    """Percentiles of a latency, µs."""

    p50_us: float
    p90_us: float
    p99_us: float
    max_us: float


def percentiles_of(samples_us: Array) -> Percentiles | None:
    """Return percentiles of samples (n,), each one of them; None if there are none."""
    if samples_us.size == 0:
        return None
    found = np.percentile(samples_us, (50.0, 90.0, 99.0, 100.0), method="inverted_cdf")
    return Percentiles(*map(float, found))


def percentiles_said(figures: Mapping[str, float], name: str) -> Percentiles | None:
    """Return the percentiles ``<name>_p50_us`` and so on that a node gives; None without any."""
    values = [figures.get(f"{name}_{field.name}") for field in fields(Percentiles)]
    known = [value for value in values if value is not None]
    if len(known) < len(values) or known[-1] == 0.0:
        return None
    # A node counts in bins and says their upper edge, but its longest to the last digit.
    p50, p90, p99, longest = known
    return Percentiles(min(p50, longest), min(p90, longest), min(p99, longest), longest)


def median_of(runs: Sequence[Percentiles]) -> Percentiles | None:
    """Return the median over runs of each percentile; None without runs."""
    if not runs:
        return None
    return Percentiles(
        *(statistics.median(getattr(run, field.name) for run in runs) for field in fields(runs[0]))
    )


def ratios(real: Percentiles, bare: Percentiles) -> dict[str, float]:
    """Return real to bare by percentile: ``p50``, ``p90``, ``p99``, ``max``."""
    return {
        field.name.removesuffix("_us"): getattr(real, field.name) / getattr(bare, field.name)
        for field in fields(Percentiles)
        if getattr(bare, field.name) > 0.0
    }
