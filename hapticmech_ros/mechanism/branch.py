# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A branch of the motion at a singular position, known from points beside it.

Where branches cross, and within rounding of that, the closures' rows do not say which directions
are along a branch: an error of φ turns them by φ/σ². The branch itself is smooth there. Its points,
the projection P onto its tangents in the mass metric, and the acceleration Ṗ v that keeps a motion
on it, are smooth functions along it, and beside the crossing the rows give them. What the branch
has at the crossing follows by interpolation of degree 5 between three points on each side (T10b of
docs/derivations.md).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from hapticmech_ros.arrays import Array
from hapticmech_ros.errors import ClosureError
from hapticmech_ros.mechanism.closures import Active
from hapticmech_ros.mechanism.constraint_space import ConstraintSpace
from hapticmech_ros.mechanism.loops import Loops
from hapticmech_ros.mechanism.mechanism import Mechanism
from hapticmech_ros.mechanism.projection import Projected, project
from hapticmech_ros.mechanism.tolerances import DETERMINED

# Where the points are, in multiples of the distance between two of them, and what each counts.
PLACES = (1.0, -1.0, 2.0, -2.0, 3.0, -3.0)
SHARES = (0.75, 0.75, -0.3, -0.3, 0.05, 0.05)
# Distances, rad, or m over the length, in the order in which they are tried. Interpolation is off
# by their sixth power over 20, times the sixth derivative; rows by rounding over their square.
REACHES = (4e-3, 1.2e-2, 4e-2, 1.2e-3)
# Points are looked for anew in the direction that they have shown until it changes by less than
# this share: put back onto the closures from aside they would not lie evenly.
ALIGNED, ALIGNMENTS = 1e-4, 4
# A direction is a branch's if the closures turn it by less than this share; and bend it by less
# than the other, over the distance.
STRAIGHT, BENT = 0.02, 0.2


class Branch:
    """A branch of the motion through a configuration, or next to it.

    Attributes:
        q: (nq,) the branch's point there.
    """

    def __init__(
        self, mechanism: Mechanism, q: Array, active: Active, points: Sequence[Projected]
    ) -> None:
        self._mechanism = mechanism
        self._active = active
        self._points = points
        changes = [mechanism.difference(q, point.q) for point in points]
        self.q = mechanism.integrate(q, _interpolated(changes))

    def closed_rates(self, rates: Array) -> Array:
        """Return the rates P ``rates`` (nv,) along the branch that are nearest, in the mass metric.

        Args:
            rates: (nv,) rad/s or m/s; or a change, rad or m.
        """
        return _interpolated([point.closing.space.closed_rates(rates) for point in self._points])

    def bend(self, v: Array) -> Array:
        """Return Ṗ v (nv,), rad/s² or m/s²: what the closures add to a motion along the branch.

        Args:
            v: (nv,) rates along the branch, rad/s or m/s.
        """
        mechanism, found = self._mechanism, []
        for point in self._points:
            along = point.closing.space.closed_rates(v)
            terms = mechanism.evaluate(point.q, along, self._active, point.closing)
            found.append(-point.closing.space.correction(terms.closure_bias))
        return _interpolated(found)


def branch_along(
    mechanism: Mechanism,
    q: Array,
    active: Active,
    space: ConstraintSpace,
    direction: Array,
    loops: Loops,
) -> Branch | None:
    """Return the branch through q in a direction; None if there is none, or it stays singular.

    Beside q it is looked for along the loops' coordinates alone: what else moves, and be it faster
    by far, does not change which directions these have.

    Args:
        mechanism: whose closures.
        q: (nq,) a configuration next to the closures.
        active: which closures are closed.
        space: their terms at q.
        direction: (nv,) of any length.
        loops: whose branch it is.
    """
    along, size = loops.part(direction), space.size
    for reach in REACHES:
        for _ in range(ALIGNMENTS):
            span = mechanism.span(along)
            if not span > 0.0:
                return None
            points = _points_beside(mechanism, q, active, space, along * (reach / span))
            if points is None:
                break
            branch = Branch(mechanism, q, active, points)
            before, along = along, loops.part(branch.closed_rates(along))
            if size(along - before) <= ALIGNED * size(along):
                return branch
    return None


def _points_beside(
    mechanism: Mechanism, q: Array, active: Active, space: ConstraintSpace, away: Array
) -> list[Projected] | None:
    """Return points of a branch; None where rows are not well determined, or it is not straight."""
    points: list[Projected] = []
    still = np.zeros(away.size)
    for place in PLACES:
        there = mechanism.integrate(q, place * away)
        try:
            point = _closest(mechanism, project(mechanism, there, still, active), active)
        except ClosureError:
            return None
        beside = point.closing.space
        if beside.least_kept < DETERMINED or (points and beside.rank != points[0].closing.rank):
            return None
        points.append(point)
    size = space.size(away)
    for ahead, behind, place in zip(points[::2], points[1::2], PLACES[::2], strict=True):
        forth = mechanism.difference(q, ahead.q) - place * away
        back = mechanism.difference(q, behind.q) + place * away
        turned, bent = space.size(forth - back), space.size(forth + back)
        if turned > 2.0 * STRAIGHT * place * size or bent > 2.0 * BENT * place * size:
            return None
    return points


def _closest(mechanism: Mechanism, point: Projected, active: Active) -> Projected:
    """Return a point on the closures to rounding, if another step of the projection leads there."""
    closing = point.closing
    q = mechanism.integrate(point.q, -closing.space.correction(closing.residual))
    again = mechanism.closing_terms(q, active)
    return Projected(q, point.v, again.error, again) if again.error < point.error else point


def _interpolated(values: Sequence[Array]) -> Array:
    """Return (nv,) the value between those at ``PLACES``."""
    return np.asarray(sum(share * value for share, value in zip(SHARES, values, strict=True)))
