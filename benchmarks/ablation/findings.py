# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What the times say: cost of each feature, and whether what is not used costs anything."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import sqrt
from time import perf_counter_ns

import numpy as np

from benchmarks.ablation.loop import PARTS, Loop
from benchmarks.ablation.scenes import Pair, Variant
from hapticmech_ros.analysis.study import Show, silent
from hapticmech_ros.numerics import Array
from hapticmech_ros.plan.scene_plan import plan_scene
from hapticmech_ros.scene import Scene
from hapticmech_ros.session import Session

# A difference is seen from so many of its standard errors on, and counts from this share of a tick.
ERRORS, SHARE = 3.0, 0.01
# Standard error of a median over that of a mean, of normally distributed numbers.
OF_MEDIAN = sqrt(np.pi / 2.0)
# Spread of normally distributed numbers over their median absolute deviation.
OF_DEVIATION = 1.4826
# m or rad, by which coordinates of scenes that move alike may differ.
ALIKE = 1e-12
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
        alike: whether both move as they are to.
        without_us, having_us: median tick.
        increment_us: median over rounds of the median difference of the same tick.
        error_us: standard error of that.
    """

    name: str
    without: str
    having: str
    alike: bool
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
    variants: Sequence[Variant], ticks_us: Array, parts_us: Array
) -> tuple[AblationStep, ...]:
    """Return what was found of each scene of the ladder, in its order.

    Args:
        variants: the scenes.
        ticks_us: (scenes, rounds, ticks) of whole ticks, µs.
        parts_us: (scenes, rounds, ticks, 4) of ``PARTS``, µs.
    """
    medians, by_round = np.median(ticks_us, axis=(1, 2)).tolist(), np.median(ticks_us, axis=2)
    found = []
    for index, variant in enumerate(variants):
        plan = plan_scene(variant.scene())
        increment, error = _middle(by_round[index] - by_round[max(index - 1, 0)])
        p90, p99 = np.percentile(ticks_us[index], (90.0, 99.0)).tolist()
        parts = np.median(parts_us[index], axis=(0, 1)).tolist()
        found.append(
            AblationStep(
                variant.name,
                *(plan.nv, plan.active_rows, plan.rank),
                *(medians[index], p90, p99, medians[index] / medians[0]),
                *(increment, error, dict(zip(PARTS, parts, strict=True))),
            )
        )
    return tuple(found)


def unused(pair: Pair, alike: bool, without: Array, having: Array) -> Unused:
    """Return what was found of a pair, of whose ticks (rounds, ticks) are given, µs."""
    increment, error = _middle(np.median(having - without, axis=1))
    return Unused(
        pair.name,
        pair.without.name,
        pair.having.name,
        alike,
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


def moves_alike(pair: Pair, ticks: int) -> bool:
    """Return whether both scenes of a pair move alike, as they have to unless the thing is used."""
    without, having = Session(pair.without.scene()), Session(pair.having.scene())
    for _ in range(ticks):
        one, other = without.tick().mechanism.q, having.tick().mechanism.q
    return not pair.alike or bool(np.allclose(one, other, rtol=0.0, atol=ALIKE))


def time_in_turn(
    variants: Sequence[Variant], rounds: int, ticks: int, show: Show = silent
) -> tuple[Array, Array]:
    """Return the times of ticks of every variant, whole ones and part by part, as above.

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
            whole[index, turn] = side_by_side((scene,), 1, ticks)
            parts[index, turn] = Loop(scene).timed(WARM_TICKS + ticks)[WARM_TICKS:]
    return whole, parts / 1e3


def side_by_side(scenes: Sequence[Scene], rounds: int, ticks: int) -> Array:
    """Time sessions side by side, tick by tick, the first one and the last one first in turn.

    Each round starts all anew. A machine that slows down for a while meets all alike.

    Returns:
        (scenes, rounds, ticks) of whole ticks, µs.
    """
    taken_ns = np.zeros((len(scenes), rounds, ticks))
    for turn in range(rounds):
        sessions = [Session(scene).tick for scene in scenes]
        for number in range(-WARM_TICKS, ticks):
            for side in range(len(scenes))[:: 1 if number % 2 else -1]:
                begun = perf_counter_ns()
                sessions[side]()
                taken = perf_counter_ns() - begun
                if number >= 0:
                    taken_ns[side, turn, number] = taken
    return taken_ns / 1e3
