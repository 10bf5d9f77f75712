# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Which coordinates the closures of a mechanism move, loop by loop.

A closure is about the joints on the path from one of its frames to the other, a coupling about its
two joints. Closures that share none of these have nothing to do with each other, and nothing else
changes φ: a branch of the motion is one of these coordinates, whatever the others do.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from hapticmech_ros.arrays import Array
from hapticmech_ros.mechanism.closures import Active
from hapticmech_ros.mechanism.constraint_space import Closing, ConstraintSpace, solve_lower
from hapticmech_ros.mechanism.mechanism import Mechanism
from hapticmech_ros.mechanism.tolerances import SINGULAR, SOLVER_RANK_TOLERANCE


class Loops:
    """Coordinates of some closures that are connected.

    Args:
        mechanism: whose.
        rates: (nv,) True for each of these coordinates.
        rows: of W, of these closures.
    """

    def __init__(self, mechanism: Mechanism, rates: Array, rows: Sequence[int]) -> None:
        self._mechanism = mechanism
        self._others = np.flatnonzero(~rates)
        self.rates = rates
        self.rows = list(rows)

    def part(self, change: Array) -> Array:
        """Return a change (nv,) without what other coordinates do, rad or m.

        Args:
            change: (nv,) rad or m; or rates, rad/s or m/s.
        """
        return np.where(self.rates, change, 0.0) if self._others.size else change

    def span(self, change: Array) -> float:
        """Return the largest component of these coordinates' change, rad, or m over the length.

        Args:
            change: (nv,) rad or m.
        """
        return self._mechanism.span(self.part(change))

    def size(self, space: ConstraintSpace, change: Array) -> float:
        """Return the length of a change in the mass metric, the least that others leave of it.

        What these coordinates do carries others along: minₓ |Lᵀ (change + x)| over x that do not
        move these.

        Args:
            space: the closures' terms.
            change: (nv,) rad or m; or rates, rad/s or m/s.
        """
        if not self._others.size:
            return space.size(change)
        turned = space.factor.T
        basis, _ = np.linalg.qr(turned[:, self._others])
        whole = turned @ change
        return float(np.linalg.norm(whole - basis @ (basis.T @ whole)))

    def singular_values(self, closing: Closing) -> Array:
        """Return (k,) σ of these closures alone, descending; see ``ConstraintSpace.sigma``.

        Args:
            closing: the closures' terms.
        """
        units = closing.active_set.model.units
        scaled = closing.jacobian[self.rows] / units[self.rows, None]
        sigma = np.linalg.svd(solve_lower(closing.space.factor, scaled.T), compute_uv=False)
        return np.asarray(sigma)


def loops_of(mechanism: Mechanism, active: Active) -> list[Loops]:
    """Return the loops that the active closures form.

    Args:
        mechanism: whose closures.
        active: per closure, whether it is closed.
    """
    groups: list[tuple[Array, list[int]]] = []
    first = 0
    for index, loop in enumerate(mechanism.closures):
        if not active[index]:
            continue
        rates, rows = mechanism.rates_in(index), list(range(first, first + loop.rows))
        first += loop.rows
        apart = []
        for others, theirs in groups:
            if (others & rates).any():
                rates, rows = rates | others, theirs + rows
            else:
                apart.append((others, theirs))
        groups = [*apart, (rates, rows)]
    return [Loops(mechanism, rates, rows) for rates, rows in groups]


def near_singular(
    mechanism: Mechanism, loops: Sequence[Loops], here: Closing, beside: Closing | None
) -> Loops:
    """Return those loops together that are next to a singular position; all, if none is.

    Args:
        mechanism: whose.
        loops: of it.
        here: the closures' terms at the position.
        beside: and next to it, if known; where a loop has more rank there, it is at one here.
    """
    chosen = [one for one in loops if _is_near(one, here, beside)] if len(loops) > 1 else []
    chosen = chosen or list(loops)
    # Without closures nothing is singled out.
    rates = np.full(mechanism.nv, not chosen)
    for one in chosen:
        rates |= one.rates
    return Loops(mechanism, rates, [row for one in chosen for row in one.rows])


def _is_near(loops: Loops, here: Closing, beside: Closing | None) -> bool:
    sigma = loops.singular_values(here)
    largest = here.space.sigma.max(initial=0.0)
    kept = sigma[sigma > SOLVER_RANK_TOLERANCE * largest]
    if kept.size and kept[-1] < SINGULAR * largest:
        return True
    if beside is None:
        return False
    there = loops.singular_values(beside)
    most = beside.space.sigma.max(initial=0.0)
    return bool(np.count_nonzero(there > SOLVER_RANK_TOLERANCE * most) > kept.size)
