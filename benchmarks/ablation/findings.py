# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What the times say: cost of each feature, and whether what is not used costs anything."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import sqrt
from time import perf_counter_ns

import numpy as np

from benchmarks.ablation.agreement import Agreement
from benchmarks.ablation.loop import PARTS, Loop
from benchmarks.ablation.scenes import Pair, Variant
from hapticmech_ros.analysis.study import Show, silent
from hapticmech_ros.numerics import Array
from hapticmech_ros.plan.scene_plan import ScenePlan
from hapticmech_ros.session import Session

# A difference is seen from so many of its standard errors on, and counts from this share of a tick.
ERRORS, SHARE = 3.0, 0.01
# Standard error of a median over that of a mean, of normally distributed numbers.
OF_MEDIAN = sqrt(np.pi / 2.0)
# Spread of normally distributed numbers over their median absolute deviation.
OF_DEVIATION = 1.4826
# Ticks at the start of each block that are not counted: caches fill.
WARM_TICKS = 20
# Turns between lines that tell how far it is.
TOLD = 10


@dataclass(frozen=True, slots=True)
class AblationStep:
    """A scene of the ladder.

    Attributes:
        name: what it has more than the one before.
        nv, rows, rank: of the mechanism, and of the closures active at the start.
        apart: largest relative difference of kernels and their Python.
        agrees: whether that is rounding.
        median_us, p90_us, p99_us: of a whole tick.
        ratio: median over that of the first step.
        increment_us: median of the differences to the step before, round by round; 0 for the first.
        error_us: standard error of that.
        parts_us: median of each part.
    """

    name: str
    nv: int
    rows: int
    rank: int
    apart: float
    agrees: bool
    median_us: float
    p90_us: float
    p99_us: float
    ratio: float
    increment_us: float
    error_us: float
    parts_us: dict[str, float]


@dataclass(frozen=True, slots=True)
class Unused:
    """A pair of scenes, with and without a thing that is not used.

    Attributes:
        name: the thing.
        without, having: names of the scenes.
        agrees: whether kernels and their Python agree in both.
        without_us, having_us: median tick.
        increment_us: median over rounds of the median difference of the same tick.
        error_us: standard error of that.
    """

    name: str
    without: str
    having: str
    agrees: bool
    without_us: float
    having_us: float
    increment_us: float
    error_us: float

    @property
    def share(self) -> float:
        """The increment as a share of the tick without."""
        return self.increment_us / self.without_us

    @property
    def seen(self) -> bool:
        """Whether the increment is more than its error."""
        return self.increment_us > ERRORS * self.error_us

    @property
    def costs(self) -> bool:
        """Whether it is more than its error, and a share of the tick that is worth a word."""
        return self.seen and self.share > SHARE

    @property
    def verdict(self) -> str:
        """What to say of it."""
        if not self.seen:
            return f"nothing that {ERRORS * self.error_us:.2f} µs would not hide"
        what = f"{self.increment_us:.1f} µs, {self.share:.1%} of a tick"
        return f"costs {what}" if self.costs else f"next to nothing: {what}"


def ablation_steps(
    names: Sequence[str],
    plans: Sequence[ScenePlan],
    agreements: Sequence[Agreement],
    times: Sequence[Times],
) -> tuple[AblationStep, ...]:
    """Return what was found of each scene of the ladder, in its order."""
    found = []
    for index, (name, plan, agreed, time) in enumerate(
        zip(names, plans, agreements, times, strict=True)
    ):
        before = times[max(index - 1, 0)]
        increment, error = _middle(time.rounds_us - before.rounds_us)
        found.append(
            AblationStep(
                name=name,
                nv=plan.nv,
                rows=plan.active_rows,
                rank=plan.rank,
                apart=max(agreed.apart.values()),
                agrees=agreed.held,
                median_us=time.median_us,
                p90_us=time.percentile_us(90.0),
                p99_us=time.percentile_us(99.0),
                ratio=time.median_us / times[0].median_us,
                increment_us=increment,
                error_us=error,
                parts_us={part: time.part_us(part) for part in PARTS},
            )
        )
    return tuple(found)


def unused(pair: Pair, agrees: bool, without: Array, having: Array) -> Unused:
    """Return what was found of a pair, of whose ticks (rounds, ticks) are given, µs."""
    increment, error = _middle(np.median(having - without, axis=1))
    return Unused(
        pair.name,
        pair.without.name,
        pair.having.name,
        agrees,
        float(np.median(without)),
        float(np.median(having)),
        increment,
        error,
    )


def _middle(differences: Array) -> tuple[float, float]:
    """Return the median of differences, and its standard error by their spread."""
    middle = float(np.median(differences))
    spread = OF_DEVIATION * float(np.median(np.abs(differences - middle)))
    return middle, OF_MEDIAN * spread / sqrt(differences.size)


@dataclass(frozen=True, slots=True)
class Times:
    """Times of one scene.

    Attributes:
        ticks_us: (rounds, ticks) of whole ticks, µs; column k is the same tick in every round.
        parts_us: (rounds, ticks, 4) of the ``PARTS``, µs.
    """

    ticks_us: Array
    parts_us: Array

    @property
    def rounds_us(self) -> Array:
        """(rounds,) median tick of each round, µs."""
        return np.asarray(np.median(self.ticks_us, axis=1))

    @property
    def median_us(self) -> float:
        """Median of all ticks, µs."""
        return float(np.median(self.ticks_us))

    def percentile_us(self, percent: float) -> float:
        """Return a percentile of all ticks, µs."""
        return float(np.percentile(self.ticks_us, percent))

    def part_us(self, part: str) -> float:
        """Return the median of a part, µs."""
        return float(np.median(self.parts_us[:, :, PARTS.index(part)]))


def time_in_turn(
    variants: Sequence[Variant], rounds: int, ticks: int, show: Show = silent
) -> list[Times]:
    """Time the ticks of every variant, whole ones and part by part.

    Each block is a session from its start, so that every round computes the same numbers.

    Args:
        variants: what to time.
        rounds: how often each has its turn.
        ticks: that are counted in a turn.
        show: told of the progress.
    """
    scenes = [variant.scene() for variant in variants]
    whole = np.zeros((len(scenes), rounds, ticks))
    parts = np.zeros((len(scenes), rounds, ticks, len(PARTS)))
    for turn in range(rounds):
        if turn % TOLD == 0:
            show(f"turn {turn + 1} of {rounds}")
        for index, scene in enumerate(scenes):
            _time_session(Session(scene), whole[index, turn])
            _time_parts(Loop(scene), parts[index, turn])
    return [Times(w / 1e3, p / 1e3) for w, p in zip(whole, parts, strict=True)]


def time_pair(one: Variant, other: Variant, rounds: int, ticks: int) -> tuple[Array, Array]:
    """Time two sessions side by side, tick by tick, the first one and the second one first in turn.

    Each round starts both anew. A machine that slows down for a while meets both alike.

    Returns:
        (rounds, ticks) of whole ticks, µs, of each.
    """
    scenes = one.scene(), other.scene()
    taken_ns = np.zeros((2, rounds, ticks))
    for turn in range(rounds):
        sessions = [Session(scene).tick for scene in scenes]
        for number in range(-WARM_TICKS, ticks):
            for side in (0, 1) if number % 2 else (1, 0):
                begun = perf_counter_ns()
                sessions[side]()
                ended = perf_counter_ns()
                if number >= 0:
                    taken_ns[side, turn, number] = ended - begun
    return taken_ns[0] / 1e3, taken_ns[1] / 1e3


def _time_session(session: Session, taken_ns: Array) -> None:
    tick = session.tick
    for _ in range(WARM_TICKS):
        tick()
    for index in range(taken_ns.size):
        begun = perf_counter_ns()
        tick()
        taken_ns[index] = perf_counter_ns() - begun


def _time_parts(loop: Loop, taken_ns: Array) -> None:
    unseen = np.zeros(len(PARTS))
    for _ in range(WARM_TICKS):
        loop.timed_tick(unseen)
    for row in taken_ns:
        loop.timed_tick(row)
