# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What nodes say of themselves, what two of their statuses say of the time between, percentiles."""

from __future__ import annotations

import math
import statistics
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields

import numpy as np

from hapticmech_ros.numerics import Array
from hapticmech_ros.numerics.times import NANOSECONDS
from hapticmech_ros.wire.topics import ANALYSER, CONTROLLER, DEVICE, MECHANISM

# What a node's own figures measure: each message's arrival less its stamp.
SAID_HOPS: dict[str, tuple[str, str]] = {
    "device → controller → device": (DEVICE, "loop_latency"),
    "device → controller → mechanism": (MECHANISM, "message_age"),
    "mechanism → analyser": (ANALYSER, "message_age"),
    "all that the controller hears": (CONTROLLER, "message_age"),
}
ROUND_TRIP = "device → controller → device"
ANSWERS = {ANALYSER: "analyses", CONTROLLER: "answers"}


@dataclass(frozen=True, slots=True)
class Status:
    """One status of a node: time of its clock, a sentence, and figures that are numbers."""

    node: str
    stamp_ns: int
    message: str
    figures: Mapping[str, float]


@dataclass(frozen=True, slots=True)
class Clocked:
    """A clocked node within a window.

    Attributes:
        rate_hz: samples published per second.
        periods: periods that began; ``missed`` of them had gone by when their turn came.
        dropped: periods that were never simulated.
    """

    rate_hz: float
    periods: int
    missed: int
    dropped: int


def status_of(facts: Mapping[str, object]) -> Status:
    """Return the status in a line of the probe's."""
    given = facts.get("figures")
    figures = {}
    for key, text in given.items() if isinstance(given, Mapping) else ():
        try:
            value = float(text)
        except ValueError:
            continue
        if math.isfinite(value):
            figures[key] = value
    stamp = facts.get("stamp_ns")
    return Status(
        str(facts.get("node")),
        stamp if isinstance(stamp, int) else 0,
        str(facts.get("message")),
        figures,
    )


def around(
    statuses: Sequence[Status], node: str, window: tuple[int, int]
) -> tuple[Status, Status] | None:
    """Return a node's last status before a window (ns) and its first one behind; None without."""
    own = [status for status in statuses if status.node == node]
    before = [status for status in own if status.stamp_ns <= window[0]]
    behind = [status for status in own if status.stamp_ns >= window[1]]
    return (before[-1], behind[0]) if before and behind else None


def gained(ends: tuple[Status, Status], figure: str) -> float:
    """Return by how much a figure grew between two statuses."""
    return ends[1].figures.get(figure, 0.0) - ends[0].figures.get(figure, 0.0)


def rate_hz(ends: tuple[Status, Status], figure: str) -> float:
    """Return a counter's rate between two statuses, 1/s of the node's own clock."""
    elapsed = (ends[1].stamp_ns - ends[0].stamp_ns) / NANOSECONDS
    return gained(ends, figure) / elapsed if elapsed > 0.0 else 0.0


def clocked(ends: tuple[Status, Status]) -> Clocked:
    """Return how a node kept its deadlines between two statuses."""
    return Clocked(
        rate_hz(ends, "periods") - rate_hz(ends, "missed_deadlines"),
        round(gained(ends, "periods")),
        round(gained(ends, "missed_deadlines")),
        round(gained(ends, "dropped_periods")),
    )


def said(ends: Mapping[str, tuple[Status, Status]]) -> dict[str, Percentiles]:
    """Return the latencies that nodes give at a window's end, by hop.

    A node counts from its first message on, so what came before the window is in them.
    """
    found = {}
    for hop, (node, figure) in SAID_HOPS.items():
        if node in ends and (latency := percentiles_said(ends[node][1].figures, figure)):
            found[hop] = latency
    return found


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
