# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A step that starts at, lands on, or passes next to a singular position.

The rule of integration is the classical one of Runge and Kutta, whatever the scene's, with every
stage put onto the branch that the mechanism is on (:mod:`~hapticmech_ros.mechanism.singular`). So
none is off the closures, where next to a crossing rows say nothing of the branch; and the error of
what a stage needs there is that of an interpolation. The step is divided until its energy account
closes.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from contextlib import suppress
from typing import NamedTuple

import numpy as np

from hapticmech_ros.arrays import Array
from hapticmech_ros.errors import ClosureError
from hapticmech_ros.mechanism.closures import Active
from hapticmech_ros.mechanism.constraint_space import Closing
from hapticmech_ros.mechanism.mechanism import Mechanism
from hapticmech_ros.mechanism.motion import ExternalWrenches, HeldMotion, Rates, Start, Stepped
from hapticmech_ros.mechanism.projection import project, refuse_flipped, refuse_open
from hapticmech_ros.mechanism.refinement import Balance
from hapticmech_ros.mechanism.schemes import SCHEMES
from hapticmech_ros.mechanism.singular import (
    REACH,
    Branch,
    Loops,
    branch_along,
    free_change,
    loops_of,
    near_singular,
    nearest_branch,
)
from hapticmech_ros.mechanism.tolerances import SINGULAR

# Parts of the step move no joint of a loop next to a singular position further, rad, or m over the
# length...
LARGEST_PART = 5e-3
# ...and are halved until the energy account of the step closes to this share of the kinetic energy
# and of what was exchanged; or so many times.
ACCOUNT_TOLERANCE = 1e-9
HALVINGS = 3


class _Stage(NamedTuple):
    """A state on the branch, with its rates.

    Attributes:
        q: (nq,) configuration.
        v: (nv,) rates, rad/s or m/s.
        rates: v̇ and powers.
        closing: the closures' terms at q.
    """

    q: Array
    v: Array
    rates: Rates
    closing: Closing


class BranchMotion:
    """The equations of motion on a branch, with wrenches held.

    Args:
        mechanism: that moves.
        start: of the step.
        external: constant during the step.
        step: s.

    Attributes:
        span: how far the step moves a joint of the loops that are next to a singular position, rad,
            or m over the length, to first order in forces.
        has_branch: whether a branch was found, or none is needed.
    """

    def __init__(
        self, mechanism: Mechanism, start: Start, external: ExternalWrenches, step: float
    ) -> None:
        self._mechanism = mechanism
        self._active: Active = start.active
        self._open: Active = tuple(False for _ in start.active)
        self._external = external
        q, v = start.q, start.v
        closing = start.closing or mechanism.closing_terms(q, start.active)
        free = self._free_rates(q, v).acceleration
        change = free_change(closing.space, step * v + 0.5 * step**2 * free)
        self._rank = closing.rank
        self._direction, self.has_branch = change, True
        beside, loops = None, loops_of(mechanism, start.active)
        away = _away(loops, change)
        if away.any():
            with suppress(ClosureError):
                there = mechanism.integrate(q, away)
                beside = project(mechanism, there, np.zeros(v.size), start.active).closing
                self._rank = max(self._rank, beside.rank)
        self._loops = near_singular(mechanism, loops, closing, beside)
        self.span = self._loops.span(change)
        if self._is_near(closing):
            found = nearest_branch(mechanism, q, start.active, closing.space, change, self._loops)
            self.has_branch = found is not None
            if found is not None:
                self._direction = found

    def at(self, q: Array, v: Array) -> _Stage:
        """Return the state on the branch next to (q, v), and its rates.

        Args:
            q: (nq,) configuration.
            v: (nv,) rates, rad/s or m/s.

        Raises:
            ClosureError: a closed loop came apart.
        """
        mechanism, active = self._mechanism, self._active
        closing = mechanism.closing_terms(q, active)
        branch = self._branch(q, closing) if self._is_near(closing) else None
        if branch is None:
            put = project(mechanism, q, v, active)
            if not self._is_near(put.closing):
                return self._regular(put.q, put.v, put.closing)
            branch = self._branch(put.q, put.closing)
            if branch is None:
                return self._regular(put.q, put.v, put.closing)
        along = branch.closed_rates(v)
        free = self._free_rates(branch.q, along)
        acceleration = branch.closed_rates(free.acceleration) + branch.bend(along)
        closing = mechanism.closing_terms(branch.q, active)
        return _Stage(branch.q, along, free._replace(acceleration=acceleration), closing)

    def projection(self, q: Array) -> Array | None:
        """Return the projection onto the branch next to q; None where rows determine it.

        Args:
            q: (nq,) configuration.

        Returns:
            (nv, nv) Lᵀ P L⁻ᵀ, in the mass metric.
        """
        closing = self._mechanism.closing_terms(q, self._active)
        if not (self.has_branch and self._is_near(closing)):
            return None
        branch, space = self._branch(q, closing), closing.space
        if branch is None:
            return None
        along = [
            branch.closed_rates(space.from_mass_metric(one)) for one in np.eye(len(space.factor))
        ]
        return np.asarray(space.factor.T @ np.array(along).T)

    def _regular(self, q: Array, v: Array, closing: Closing) -> _Stage:
        start = Start(q, v, self._active, closing=closing)
        return _Stage(q, v, HeldMotion(self._mechanism, start, self._external)(q, v), closing)

    def _branch(self, q: Array, closing: Closing) -> Branch | None:
        return branch_along(
            self._mechanism, q, self._active, closing.space, self._direction, self._loops
        )

    def _is_near(self, closing: Closing) -> bool:
        """Return whether rows say too little, or some of them nothing, of the branch."""
        return closing.rank < self._rank or closing.space.least_kept < SINGULAR

    def _free_rates(self, q: Array, v: Array) -> Rates:
        """Return what there would be without closures."""
        return HeldMotion(self._mechanism, Start(q, v, self._open), self._external)(q, v)


def _away(loops: Sequence[Loops], change: Array) -> Array:
    """Return a change (nv,) by which each of the loops moves alike, as ``change`` turns it."""
    away = np.zeros(change.size)
    for one in loops:
        span = one.span(change)
        if span > 0.0:
            away += one.part(change) * (2.0 * REACH / span)
    return away


def branch_projection(
    mechanism: Mechanism, start: Start, external: ExternalWrenches, step: float
) -> Array | None:
    """Return what the branch that a step starts on leaves free of a force, in the mass metric.

    Args:
        mechanism: that moves.
        start: of the step.
        external: constant during the step.
        step: s.

    Returns:
        (nv, nv) Lᵀ P L⁻ᵀ; None where the closures' rows say it.
    """
    return BranchMotion(mechanism, start, external, step).projection(start.q)


def careful_step(
    mechanism: Mechanism,
    start: Start,
    external: ExternalWrenches,
    step: float,
    balance_of: Callable[[Stepped], Balance],
) -> Stepped | None:
    """Return the state after a step; None where no branch takes up any of the motion.

    Args:
        mechanism: that moves.
        start: of the step.
        external: constant during the step.
        step: s.
        balance_of: returns the energy account of such a step.

    Raises:
        ClosureError: a closed loop came apart, or turned to its other branch.
    """
    motion = BranchMotion(mechanism, start, external, step)
    if not motion.has_branch:
        return None
    first = motion.at(start.q, start.v)
    parts = max(1, math.ceil(motion.span / LARGEST_PART))
    best, least = None, math.inf
    for _ in range(HALVINGS + 1):
        stepped = _in_parts(mechanism, motion, first, step, parts)
        balance = balance_of(stepped)
        if best is None or balance.judged < least:
            best, least = stepped, balance.judged
        if balance.is_within(ACCOUNT_TOLERANCE):
            break
        parts *= 2
    if best is not None:
        refuse_open(mechanism, best.error, start.active)
        refuse_flipped(mechanism, best.q, best.error, start.active)
    return best


def _in_parts(
    mechanism: Mechanism, motion: BranchMotion, first: _Stage, step: float, parts: int
) -> Stepped:
    """Return the state after a step that is done in parts."""
    stage, exchanged = first, np.zeros(3)
    for _ in range(parts):
        stage, done = _part(mechanism, motion, stage, step / parts)
        exchanged += done
    work_in, lost, by_contacts = exchanged.tolist()
    q, v, closing = stage.q, stage.v, stage.closing
    return Stepped(q, v, closing.error, closing, work_in, lost, contact_work=by_contacts)


def _part(
    mechanism: Mechanism, motion: BranchMotion, first: _Stage, step: float
) -> tuple[_Stage, Array]:
    """Return the end of a step by the classical rule of order 4, and what was exchanged (3,), J.

    That is work done, energy lost, and work by contacts.
    """
    scheme, stage = SCHEMES["rk4"], first
    turned, gained = np.zeros(first.v.size), np.zeros(first.v.size)
    exchanged = np.zeros(3)
    for weight, fraction in zip(scheme.weights, (*scheme.fractions, 0.0), strict=True):
        turn = mechanism.local_rates(first.q, stage.q, stage.v)
        turned += weight * turn
        gained += weight * stage.rates.acceleration
        exchanged += weight * step * np.array(stage.rates[1:])
        if fraction > 0.0:
            reached = fraction * step
            stage = motion.at(
                mechanism.integrate(first.q, reached * turn),
                first.v + reached * stage.rates.acceleration,
            )
    end = motion.at(mechanism.integrate(first.q, step * turned), first.v + step * gained)
    return end, exchanged
