# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Work against precision: each peer's best runs, and what an error costs along them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import astuple, dataclass
from math import exp, log

import numpy as np

from benchmarks.speed.result import RunResult
from benchmarks.work_precision import SMALLEST

TARGETS = (1e-4, 1e-6, 1e-8)


@dataclass(frozen=True, slots=True)
class Point:
    """Of a front: error (m or rad) and CPU time (s per simulated second)."""

    error: float
    cpu_s_per_s: float


@dataclass(frozen=True, slots=True)
class Ratio:
    """What an error costs us and the best of the others.

    Attributes:
        problem: name.
        target: error, m or rad.
        ours: CPU time, s per simulated second; None if not reached.
        best: of the others, likewise.
        best_peer: whose; empty if none reaches the target.
    """

    problem: str
    target: float
    ours: float | None
    best: float | None
    best_peer: str

    @property
    def value(self) -> float | None:
        """Our CPU time over theirs; None unless both are known."""
        return None if self.ours is None or self.best is None else self.ours / self.best


def front(results: Sequence[RunResult], peer: str) -> tuple[Point, ...]:
    """Return a peer's runs of which none other is cheaper and as accurate; cheapest first."""
    points = sorted(
        (result.median, max(result.error, SMALLEST))
        for result in results
        if result.peer == peer and not result.failure
    )
    kept: list[Point] = []
    for cpu, error in points:
        if not kept or error < kept[-1].error:
            kept.append(Point(error, cpu))
    return tuple(kept)


def cost(points: Sequence[Point], target: float) -> float | None:
    """Return the CPU time (s per simulated second) at which a front reaches an error.

    Between two points, straight in logarithms. Nothing is extrapolated: None if the front does not
    get there, and the time of the cheapest run if that one is more accurate already.
    """
    if not points or points[-1].error > target:
        return None
    errors, times = ([log(x) for x in of] for of in zip(*map(astuple, points), strict=True))
    # Rising errors, as interpolation wants them: the most accurate run first.
    return exp(np.interp(log(target), errors[::-1], times[::-1]))


def ratios(results: Sequence[RunResult], own: str) -> tuple[Ratio, ...]:
    """Return for each problem and target what we need beside the best of the others."""
    found = []
    for name in dict.fromkeys(result.problem for result in results):
        members = [result for result in results if result.problem == name]
        peers = [peer for peer in dict.fromkeys(result.peer for result in members) if peer != own]
        for target in TARGETS:
            costs = {peer: cost(front(members, peer), target) for peer in peers}
            reached = {peer: value for peer, value in costs.items() if value is not None}
            best = min(reached, key=reached.__getitem__) if reached else ""
            ours = cost(front(members, own), target)
            found.append(Ratio(name, target, ours, reached.get(best), best))
    return tuple(found)
