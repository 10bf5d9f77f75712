"""The step that leaves a singular position: which branch it takes, and with what speed.

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
from hapticmech_ros.mechanism.closures import Active
from hapticmech_ros.mechanism.constraint_space import ConstraintSpace
from hapticmech_ros.mechanism.mechanism import Mechanism
from hapticmech_ros.mechanism.projection import Projected, project
from hapticmech_ros.mechanism.tolerances import NEAR, PASSING, PROJECTION_TOLERANCE

# How far from the singular position branches are looked for, rad or m: far enough that their
# closures are well determined, near enough that they are straight.
REACH = 1e-3
# A direction that the closures change by less than this share is a branch's.
STRAIGHT = 0.02
# A branch that takes up this share of the free motion is the one the mechanism is on already.
SURE = 0.999
# Branches are looked for in the direction of the free motion, and in so many others for each
# direction that is free. The same ones each time: results repeat to the bit.
TRIES = 8
MOST_TRIES = 64
# Corrections of the direction towards the nearest one on its branch.
ROUNDS = 4


def nearest_branch(
    mechanism: Mechanism, q: Array, active: Active, space: ConstraintSpace, change: Array
) -> ConstraintSpace | None:
    """Return the closures' terms on the branch through q that ``change`` is nearest to.

    Args:
        mechanism: whose closures.
        q: (nq,) a singular position.
        active: which closures are closed.
        space: the closures' terms at q.
        change: (nv,) the free motion, rad or m.

    Returns:
        Terms whose ``closed_rates`` gives the part of a motion along that branch; None where no
        branch takes up any of the change.
    """
    whole = space.size(change)
    best, found = 1e-6 * whole, None
    for start in _directions(space, change):
        along = start
        for _ in range(ROUNDS):
            tried = _branch_towards(mechanism, q, active, space, along)
            if tried is None:
                break
            branch, is_on_it = tried
            size = space.size(along)
            if is_on_it and along is not start and size > best:
                best, found = size, branch
            along = branch.closed_rates(change)
            if not space.size(along) > 1e-6 * whole:
                break
        if best > SURE * whole:
            break
    return found


def _directions(space: ConstraintSpace, change: Array) -> Iterator[Array]:
    """Yield directions (nv,) that are free to first order, the change itself first."""
    yield change
    size = change.size
    # No two of them are alike, and none is singled out by the mechanism.
    for k in range(1, 1 + min(TRIES * (size - space.rank), MOST_TRIES)):
        anywhere = np.cos(np.sqrt(2.0) * k * np.arange(1.0, size + 1.0) ** 2)
        yield space.from_mass_metric(space.without_closure_part(anywhere))


def _branch_towards(
    mechanism: Mechanism, q: Array, active: Active, space: ConstraintSpace, direction: Array
) -> tuple[ConstraintSpace, bool] | None:
    """Return the closures' terms where a small motion that way is put back onto the closures.

    Also return whether it was nearly on them before: where a branch keeps to a singular position,
    directions seem free that it does not have.
    """
    largest = np.abs(direction).max()
    if not largest > 0.0:
        return None
    away = direction * (REACH / largest)
    there = mechanism.integrate(q, away)
    try:
        put_back = project(mechanism, there, np.zeros(direction.size), active)
    except ClosureError:
        return None
    moved = mechanism.difference(there, put_back.q)
    return put_back.closing.space, space.size(moved) < STRAIGHT * space.size(away)


def split_around(where: float) -> float:
    """Return at which share of a step to split it if it is next to a singular one at ``where``.

    Both halves of a step by a rule of Runge and Kutta have stages at their ends and in the middle.
    That share is then between two of them, and no nearer to one than a tenth of the step.
    """
    split = (4.0 * where - 1.0) / 3.0 if where < 0.5 else 4.0 * where / 3.0
    return min(0.9, max(0.1, split))


def care_limit(moved: float) -> float:
    """Return the relative σ below which a step needs care if it moves a joint by so much."""
    return max(NEAR, min(PASSING, moved))


def put_on_branch(
    mechanism: Mechanism, q: Array, v: Array, active: Active, branch: ConstraintSpace
) -> Projected:
    """Return a state that was led along a branch, on the closures.

    Next to where branches cross it is on them to rounding, and the closures' rows there say less of
    the branch's direction than what led it.

    Args:
        mechanism: whose closures.
        q: (nq,) configuration.
        v: (nv,) rates, rad/s or m/s.
        active: per closure, whether it is closed.
        branch: along which it was led.

    Raises:
        ClosureError: as :func:`~hapticmech_ros.mechanism.projection.project`.
    """
    closing = mechanism.closing_terms(q, active)
    if closing.least < NEAR and closing.error <= PROJECTION_TOLERANCE * mechanism.length:
        return Projected(q, branch.closed_rates(v), closing.error, closing)
    return project(mechanism, q, v, active)
