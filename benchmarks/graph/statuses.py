# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What nodes say of themselves, and what two of their statuses say of the time between."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

import numpy as np

from benchmarks.children import BenchError
from hapticmech_ros.numerics import Array
from hapticmech_ros.numerics.times import NANOSECONDS
from hapticmech_ros.wire.topics import ANALYSER, CONTROLLER, DEVICE, MECHANISM

# What a node's own figures measure: each message's arrival less its stamp.
ROUND_TRIP = "device → controller → device"
SAID_HOPS: dict[str, tuple[str, str]] = {
    ROUND_TRIP: (DEVICE, "loop_latency"),
    "device → controller → mechanism": (MECHANISM, "message_age"),
    "mechanism → analyser": (ANALYSER, "message_age"),
    "all that the controller hears": (CONTROLLER, "message_age"),
}
# Node that answers -> its counter, and the clocked node whose samples it answers.
ANSWERS = {ANALYSER: ("analyses", MECHANISM), CONTROLLER: ("answers", DEVICE)}
PERCENTILES = {"p50": 50.0, "p90": 90.0, "p99": 99.0, "max": 100.0}
# Names of figures of a clocked node, behind its own.
RATE, MISSED, DROPPED = "rate, Hz", "missed deadlines, %", "dropped periods"
# A run's figures, by what they are and their unit.
Figures = dict[str, float]


@dataclass(frozen=True, slots=True)
class Status:
    """One status of a node: time of its clock, a sentence, and figures that are numbers."""

    node: str
    stamp_ns: int
    message: str
    figures: Mapping[str, float]


# By node, the statuses around a window.
Ends = Mapping[str, tuple[Status, Status]]


def status_of(facts: Mapping[str, Any]) -> Status:
    """Return the status in a line of the probe's."""
    figures = {}
    for key, text in facts["figures"].items():
        with suppress(ValueError):
            if math.isfinite(value := float(text)):
                figures[key] = value
    return Status(facts["node"], facts["stamp_ns"], facts["message"], figures)


def around(statuses: Sequence[Status], node: str, window: tuple[int, int]) -> tuple[Status, Status]:
    """Return a node's last status before a window (ns) and its first one behind.

    Raises:
        BenchError: there are not both.
    """
    own = [status for status in statuses if status.node == node]
    before = [status for status in own if status.stamp_ns <= window[0]]
    behind = [status for status in own if status.stamp_ns >= window[1]]
    if not (before and behind):
        raise BenchError(f"{node} gave no figures before and after the window")
    return before[-1], behind[0]


def gained(ends: tuple[Status, Status], figure: str) -> float:
    """Return by how much a figure grew between two statuses."""
    return ends[1].figures.get(figure, 0.0) - ends[0].figures.get(figure, 0.0)


def rate_hz(ends: tuple[Status, Status], figure: str) -> float:
    """Return a counter's rate between two statuses, 1/s of the node's own clock."""
    elapsed = (ends[1].stamp_ns - ends[0].stamp_ns) / NANOSECONDS
    return gained(ends, figure) / elapsed if elapsed > 0.0 else 0.0


def said(ends: Ends) -> Figures:
    """Return what nodes say of a window: rates, deadlines, answers, and latencies by hop.

    A node counts latencies from its first message on, so what came before the window is in them.
    """
    found: Figures = {}
    for node in (DEVICE, MECHANISM):
        periods, missed = (gained(ends[node], one) for one in ("periods", "missed_deadlines"))
        made_hz, missed_hz = (rate_hz(ends[node], one) for one in ("periods", "missed_deadlines"))
        found[f"{node}: {RATE}"] = made_hz - missed_hz
        found[f"{node}: {MISSED}"] = 100.0 * missed / periods if periods else 100.0
        found[f"{node}: {DROPPED}"] = gained(ends[node], "dropped_periods")
    for node, (counter, asking) in ANSWERS.items():
        asked_hz = max(found[f"{asking}: {RATE}"], 1e-9)
        found[f"{node}: samples answered, %"] = 100.0 * rate_hz(ends[node], counter) / asked_hz
    for hop, (node, name) in SAID_HOPS.items():
        found |= latency_said(hop, ends[node][1].figures, name)
    return found


def latency(hop: str, percentile: str) -> str:
    """Return the name of a figure: a percentile of a hop's latency."""
    return f"{hop}: {percentile}, µs"


def latency_of(hop: str, samples_us: Array) -> Figures:
    """Return percentiles of samples (n,), each one of them; none if there are none."""
    if samples_us.size == 0:
        return {}
    values = np.percentile(samples_us, list(PERCENTILES.values()), method="inverted_cdf")
    return {latency(hop, one): float(x) for one, x in zip(PERCENTILES, values, strict=True)}


def latency_said(hop: str, figures: Mapping[str, float], name: str) -> Figures:
    """Return the percentiles ``<name>_p50_us`` and so on that a node gives; none without all."""
    values = [figures.get(f"{name}_{one}_us", 0.0) for one in PERCENTILES]
    if 0.0 in values:
        return {}
    # A node counts in bins and says their upper edge, but its longest to the last digit.
    known = zip(PERCENTILES, np.minimum(values, values[-1]).tolist(), strict=True)
    return {latency(hop, one): x for one, x in known}
