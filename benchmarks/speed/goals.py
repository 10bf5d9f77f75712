# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What speed is wanted, and whether it is there."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

from benchmarks.goals import Verdict, at_most, unknown, verdict
from benchmarks.speed.fronts import cost, front, ratios
from benchmarks.speed.mujoco_peer import NAME as MUJOCO
from benchmarks.speed.own_peer import NAME as OWN
from benchmarks.speed.result import RunResult
from benchmarks.speed.scaling import TITLES, Growth
from benchmarks.speed.tick import MJ_STEP, SEE, TickTime

TICK_LIMIT = 2.5
# CPU time of the best peer over ours.
FACTOR = 3.0
RACES = ("n_four_bar_2", "five_bar", "bricard")
FACTOR_TARGETS, FINE_TARGET = (1e-4, 1e-6), 1e-8
LARGE, LARGE_TARGET, LARGE_PEER_TARGET = "n_four_bar_40", 1e-6, 7.6e-6
EXPONENT_LIMIT = 1.2


def verdicts(
    results: Sequence[RunResult], grown: Sequence[Growth], ticks: Sequence[TickTime]
) -> tuple[Verdict, ...]:
    """Return a verdict for each goal; one that nothing was measured for is ``not measured``."""
    return (_tick(ticks), *_races(results), _large(results), *_exponents(grown))


def _tick(ticks: Sequence[TickTime]) -> Verdict:
    times: Mapping[str, float] = {tick.name: tick.median for tick in ticks}
    goal = f"five-bar: a tick at most {TICK_LIMIT:g} x mj_step"
    ratio = times[SEE] / times[MJ_STEP] if {SEE, MJ_STEP} <= times.keys() else None
    return at_most(goal, ratio, TICK_LIMIT, "{:.2f} x")


def _races(results: Sequence[RunResult]) -> Iterator[Verdict]:
    known = {(ratio.problem, ratio.target): ratio for ratio in ratios(results, OWN)}
    for name in RACES:
        for target in (*FACTOR_TARGETS, FINE_TARGET):
            fine = target == FINE_TARGET
            wanted = "no peer is faster" if fine else f"{FACTOR:g} x less CPU time than any peer"
            goal = f"{name} at {target:.0e}: {wanted}"
            ratio = known.get((name, target))
            if ratio is None or not _has_peers(results, name):
                yield unknown(goal)
            elif ratio.ours is None:
                yield verdict(goal, "not reached", False)
            elif ratio.value is None:
                yield verdict(goal, "no peer gets there", True)
            else:
                seen = f"{ratio.value:.2f} x the time of {ratio.best_peer}"
                yield verdict(goal, seen, ratio.value <= (1.0 if fine else 1.0 / FACTOR))


def _large(results: Sequence[RunResult]) -> Verdict:
    goal = f"{LARGE}: {LARGE_TARGET:.0e} in less CPU time than MuJoCo's {LARGE_PEER_TARGET:.1e}"
    members = [result for result in results if result.problem == LARGE]
    if not members or not _has_peers(members, LARGE):
        return unknown(goal)
    ours = cost(front(members, OWN), LARGE_TARGET)
    theirs = cost(front(members, MUJOCO), LARGE_PEER_TARGET)
    if ours is None:
        return verdict(goal, "not reached", False)
    if theirs is None:
        return verdict(goal, "MuJoCo does not get there", True)
    return verdict(goal, f"{ours:.3g} s/s, MuJoCo {theirs:.3g} s/s", ours < theirs)


def _exponents(grown: Sequence[Growth]) -> Iterator[Verdict]:
    for family, title in TITLES.items():
        goal = f"{title}: a step's time grows with N to {EXPONENT_LIMIT:g} at most"
        own = (one.exponent for one in grown if (one.family, one.peer) == (family, OWN))
        yield at_most(goal, next(own, None), EXPONENT_LIMIT, "{:.2f}")


def _has_peers(results: Sequence[RunResult], problem: str) -> bool:
    return any(result.peer != OWN and result.problem == problem for result in results)
