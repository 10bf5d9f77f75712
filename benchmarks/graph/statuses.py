"""What nodes say of themselves, and what two of their statuses say of the time between them."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from benchmarks.graph.percentiles import Percentiles, percentiles_said
from hapticmech_ros.times import NANOSECONDS
from hapticmech_ros.wire.topic import ANALYSER, CONTROLLER, DEVICE, MECHANISM

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
