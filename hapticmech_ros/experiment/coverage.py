# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Completeness of a record: start, end and pauses of each group of samples.

If a recorder discovers a publisher late or a node stops early, averages over the record are
misleading, which only its coverage shows.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from hapticmech_ros.arrays import Array
from hapticmech_ros.experiment.record import ExperimentRecord

# Pauses longer than this (s) make a record incomplete: ten samples of the topics at view rate.
LONGEST_PAUSE_S = 0.1
# A control loop whose rate is too low for its gains oscillates within about this time.
WINDOW_S = 0.03

GROUPS = {
    "device and point": "times",
    "constraint wrench": "wrench_times",
    "analysis": "analysis_times",
    "energy": "energy_times",
}


def coverage(record: ExperimentRecord) -> dict[str, Any]:
    """Return the coverage of the run by samples, from the hand's push to the record's end.

    ``complete`` is true if no group pauses for longer than :data:`LONGEST_PAUSE_S`; ``groups``
    gives first and last time, longest pause (including both ends), number of samples, and their
    least rate over :data:`WINDOW_S`.
    """
    end = max(float(getattr(record, name)[-1]) for name in GROUPS.values() if _any(record, name))
    groups = {what: _group(getattr(record, name), end) for what, name in GROUPS.items()}
    # Tolerance of 1 ns for the rounding of times that are sums of periods.
    limit = LONGEST_PAUSE_S + 1e-9
    complete = all(group["longest_pause_s"] <= limit for group in groups.values())
    return {"complete": complete, "groups": groups}


def _any(record: ExperimentRecord, name: str) -> bool:
    return bool(getattr(record, name).size)


def _group(times: Array, end: float) -> dict[str, Any]:
    started = times[times >= 0.0]
    edges = np.concatenate(([0.0], started, [end]))
    return {
        "samples": int(started.size),
        "first_s": float(started[0]) if started.size else None,
        "last_s": float(started[-1]) if started.size else None,
        "longest_pause_s": float(np.diff(edges).max()),
        "slowest_rate_hz": _slowest_rate(edges),
    }


def _slowest_rate(times: Array) -> float | None:
    """Return the least rate of samples, 1/s, over windows that begin at a sample."""
    starts = times[times + WINDOW_S <= times[-1]]
    if not starts.size:
        return None
    # Tolerance of 0.5 ns for the rounding of times that are sums of periods.
    ends = np.searchsorted(times, starts + WINDOW_S + 5e-10, side="right")
    counts = ends - np.searchsorted(times, starts, side="right")
    return float(counts.min() / WINDOW_S)
