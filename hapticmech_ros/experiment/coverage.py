"""Whether a record holds the whole run: when each group of samples begins, ends and pauses.

A recorder that finds a publisher late, or a node that stops early, leaves a bag whose averages say
little; nothing else in the record would show it.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from hapticmech_ros.arrays import Array
from hapticmech_ros.experiment.record import ExperimentRecord

# Longer than this (s) without a sample counts as a hole: ten samples of the topics for people.
LONGEST_PAUSE_S = 0.1
# A control loop slower than its gains bear oscillates within about this long.
WINDOW_S = 0.03

GROUPS = {
    "device and point": "times",
    "constraint wrench": "wrench_times",
    "analysis": "analysis_times",
    "energy": "energy_times",
}


def coverage(record: ExperimentRecord) -> dict[str, Any]:
    """Return how far the samples cover the run, from the hand's push to the record's end.

    ``complete`` is true if no group pauses for longer than :data:`LONGEST_PAUSE_S`; ``groups``
    gives first and last time, longest pause (with those at both ends), number of samples, and
    their rate over the emptiest :data:`WINDOW_S`.
    """
    end = max(float(getattr(record, name)[-1]) for name in GROUPS.values() if _any(record, name))
    groups = {what: _group(getattr(record, name), end) for what, name in GROUPS.items()}
    # A nanosecond absorbs the rounding of times that are sums of periods.
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
    """Return the least number of samples in a window that follows one of them, per second."""
    starts = times[times + WINDOW_S <= times[-1]]
    if not starts.size:
        return None
    # Half a nanosecond absorbs the rounding of times that are sums of periods.
    ends = np.searchsorted(times, starts + WINDOW_S + 5e-10, side="right")
    counts = ends - np.searchsorted(times, starts, side="right")
    return float(counts.min() / WINDOW_S)
