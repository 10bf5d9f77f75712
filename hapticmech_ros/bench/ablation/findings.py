"""What the times say: cost of each feature, and whether what is not used costs anything."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import sqrt

import numpy as np

from hapticmech_ros.arrays import Array
from hapticmech_ros.bench.ablation.agreement import Agreement
from hapticmech_ros.bench.ablation.loop import PARTS
from hapticmech_ros.bench.ablation.pairs import Pair
from hapticmech_ros.bench.ablation.timing import Times
from hapticmech_ros.plan.scene_plan import ScenePlan

# A difference is seen from so many of its standard errors on, and counts from this share of a tick.
ERRORS, SHARE = 3.0, 0.01
# Standard error of a median over that of a mean, of normally distributed numbers.
OF_MEDIAN = sqrt(np.pi / 2.0)
# Spread of normally distributed numbers over their median absolute deviation.
OF_DEVIATION = 1.4826


@dataclass(frozen=True, slots=True)
class Rung:
    """A scene of the ladder.

    Attributes:
        name: what it has more than the one before.
        nv, rows, rank: of the mechanism, and of the closures active at the start.
        apart: largest relative difference of kernels and readable implementation.
        agrees: whether that is rounding.
        median_us, p90_us, p99_us: of a whole tick.
        ratio: median over that of the first rung.
        increment_us: median of the differences to the rung before, round by round; 0 for the first.
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
        agrees: whether kernels and the readable implementation agree in both.
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


def rungs(
    names: Sequence[str],
    plans: Sequence[ScenePlan],
    agreements: Sequence[Agreement],
    times: Sequence[Times],
) -> tuple[Rung, ...]:
    """Return what was found of each scene of the ladder, in its order."""
    found = []
    for index, (name, plan, agreed, time) in enumerate(
        zip(names, plans, agreements, times, strict=True)
    ):
        before = times[max(index - 1, 0)]
        increment, error = _middle(time.rounds_us - before.rounds_us)
        found.append(
            Rung(
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
