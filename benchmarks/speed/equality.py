# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Do all compute the same motion? Asked before anything is timed."""

from __future__ import annotations

from dataclasses import dataclass
from math import inf

from benchmarks.speed.contender import Method, Peer, Setting, State, initial_state
from benchmarks.speed.problems import Problem
from benchmarks.speed.result import run_once

# Steps in units of a problem, coarse and fine, from this order on.
STEPS = {3: (2.0, 1.0), 2: (1.0, 0.5), 0: (0.2, 0.1)}
LOW_ORDER = 1
# What a method has to reach at the fine step, m or rad: those that hold closures to rounding, and
# those that hold them softly or are of order 2; rules of order 1, which err by their step.
HARD_BOUNDS = {"hapticmech": 1e-9, "pinocchio": 1e-8}
SOFT_BOUND, LOW_ORDER_BOUND = 1e-3, 2e-2
# Halving the step has to leave at most so much of the error, unless it is this small already.
SHRINKS_TO, SMALL = 0.8, 1e-7


@dataclass(frozen=True, slots=True)
class Check:
    """Whether a peer's method computes a problem's motion.

    Attributes:
        problem, peer, method: names.
        coarse, fine: errors at two steps, m or rad, at the first time of comparison; infinite
            after a failure.
        bound: of ``fine``, m or rad.
        reason: why it does not pass; empty if it does.
        suitable: whether it could run the scene at all.
    """

    problem: str
    peer: str
    method: str
    coarse: float = inf
    fine: float = inf
    bound: float = 0.0
    reason: str = ""
    suitable: bool = True

    @property
    def passed(self) -> bool:
        """Whether the method may be timed."""
        return not self.reason


def check(problem: Problem, peer: Peer, method: Method) -> Check:
    """Run a method at two steps up to the first time of comparison.

    The first of its settings that passes is enough; without one, the setting that comes closest.
    """
    short, start = problem.shortened(), initial_state(problem.scene)
    found = []
    for setting in method.settings_for(problem.scene):
        found.append(_check(short, start, peer, method, setting))
        if found[-1].passed or not found[-1].suitable:
            break
    return min(found, key=lambda one: (not one.passed, one.fine))


def _check(problem: Problem, start: State, peer: Peer, method: Method, setting: Setting) -> Check:
    of_peer = HARD_BOUNDS.get(peer.name, SOFT_BOUND)
    bound = LOW_ORDER_BOUND if method.order <= LOW_ORDER else of_peer
    steps = next(steps for order, steps in STEPS.items() if method.order >= order)
    one, other = (
        run_once(problem, start, peer, method, multiple * problem.unit, setting)[0]
        for multiple in steps
    )
    coarse, fine, reason = one.error, other.error, one.failure or other.failure
    if not reason and fine > bound:
        reason = f"error {fine:.1e} above {bound:.0e}"
    elif not reason and fine > SMALL and fine > SHRINKS_TO * coarse:
        reason = f"error does not shrink with the step: {coarse:.1e}, then {fine:.1e}"
    return Check(problem.name, peer.name, method.name, coarse, fine, bound, reason, one.suitable)
