# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Which branch of the motion is taken at a singular position.

Where closures lose rank, several branches of the mechanism's motion cross, and to first order it is
free to move between them as well. An acceleration found there leads off all of them; put back onto
the closures row by row, the mechanism may end on a branch that no force drives, or stop where the
branches meet. Of all branches Gauss's principle of least constraint picks the one that the free
motion is nearest to in the mass metric (T10 of docs/derivations.md): what is along it stays, and so
the work done is the energy gained.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from hapticmech_ros.arrays import Array
from hapticmech_ros.errors import ClosureError
from hapticmech_ros.mechanism.branch import STRAIGHT, branch_along
from hapticmech_ros.mechanism.closures import Active
from hapticmech_ros.mechanism.constraint_space import ConstraintSpace
from hapticmech_ros.mechanism.loops import Loops
from hapticmech_ros.mechanism.mechanism import Mechanism
from hapticmech_ros.mechanism.projection import project
from hapticmech_ros.mechanism.tolerances import SINGULAR

# How far from the singular position branches are looked for, rad, or m over the length: far enough
# that their closures are well determined, near enough that they are straight.
REACH = 1e-3
# A branch that takes up this share of the free motion is the one the mechanism is on already.
SURE = 0.999
# Branches are looked for in the direction of the free motion, and in so many others for each
# direction that is free. The same ones each time: results repeat to the bit.
TRIES = 8
MOST_TRIES = 64
# Corrections of the direction towards the nearest one on its branch.
ROUNDS = 4


def nearest_branch(
    mechanism: Mechanism,
    q: Array,
    active: Active,
    space: ConstraintSpace,
    change: Array,
    loops: Loops,
) -> Array | None:
    """Return the direction (nv,) of the branch through q that ``change`` is nearest to.

    Args:
        mechanism: whose closures.
        q: (nq,) a singular position.
        active: which closures are closed.
        space: the closures' terms at q.
        change: (nv,) the free motion, rad or m.
        loops: which of its closures are singular there.

    Returns:
        None where no branch takes up any of the change.
    """
    whole = loops.size(space, change)
    best, found = 1e-6 * whole, None
    for start in _directions(space, change):
        along = start
        for _ in range(ROUNDS):
            tried = _branch_towards(mechanism, q, active, space, loops.part(along))
            if tried is None:
                break
            there, is_on_it = tried
            size = loops.size(space, along)
            may_be = is_on_it and along is not start and size > best
            if may_be and branch_along(mechanism, q, active, space, along, loops) is not None:
                best, found = size, along
                break
            along = there.closed_rates(change)
            if not loops.size(space, along) > 1e-6 * whole:
                break
        if best > SURE * whole:
            break
    return found


def without_rows_of(space: ConstraintSpace, columns: Array) -> Array:
    """Return ``columns`` (nv,) without what the closures take that are well determined.

    Args:
        space: the closures' terms.
        columns: (nv,) in the mass metric.
    """
    sigma = space.sigma
    if not sigma.size:
        return columns
    basis = space.basis[:, sigma > SINGULAR * sigma[0]]
    return np.asarray(columns - basis @ (basis.T @ columns))


def free_change(space: ConstraintSpace, change: Array) -> Array:
    """Return the part (nv,) of a change that well determined closures leave.

    Args:
        space: the closures' terms.
        change: (nv,) rad or m.
    """
    return space.from_mass_metric(without_rows_of(space, space.factor.T @ change))


def _directions(space: ConstraintSpace, change: Array) -> Iterator[Array]:
    """Yield directions (nv,) that are free to first order, the change itself first."""
    yield change
    size = change.size
    # No two of them are alike, and none is singled out by the mechanism.
    for k in range(1, 1 + min(TRIES * (size - space.rank + 1), MOST_TRIES)):
        anywhere = np.cos(np.sqrt(2.0) * k * np.arange(1.0, size + 1.0) ** 2)
        yield space.from_mass_metric(without_rows_of(space, anywhere))


def _branch_towards(
    mechanism: Mechanism, q: Array, active: Active, space: ConstraintSpace, direction: Array
) -> tuple[ConstraintSpace, bool] | None:
    """Return the closures' terms where a small motion that way is put back onto the closures.

    Also return whether it was nearly on them before: where a branch keeps to a singular position,
    directions seem free that it does not have.
    """
    span = mechanism.span(direction)
    if not span > 0.0:
        return None
    away = direction * (REACH / span)
    there = mechanism.integrate(q, away)
    try:
        put_back = project(mechanism, there, np.zeros(direction.size), active)
    except ClosureError:
        return None
    moved = mechanism.difference(there, put_back.q)
    return put_back.closing.space, space.size(moved) < STRAIGHT * space.size(away)
