"""Ticks of several scenes timed in turn: A, B, C, A, B, C, so that a drifting machine meets all."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from time import perf_counter_ns

import numpy as np

from hapticmech_ros.arrays import Array
from hapticmech_ros.bench.ablation.loop import PARTS, Loop
from hapticmech_ros.bench.ablation.variant import Variant
from hapticmech_ros.session import Session

# Ticks at the start of each block that are not counted: caches fill.
WARM_TICKS = 20
# Turns between lines that tell how far it is.
TOLD = 10

Show = Callable[[str], None]


@dataclass(frozen=True, slots=True)
class Times:
    """Times of one scene.

    Attributes:
        ticks_us: (rounds, ticks) of whole ticks, µs; column k is the same tick in every round.
        parts_us: (rounds, ticks, 5) of the ``PARTS``, µs.
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
    variants: Sequence[Variant], rounds: int, ticks: int, show: Show = lambda line: None
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
        loop.tick(unseen)
    for row in taken_ns:
        loop.tick(row)
