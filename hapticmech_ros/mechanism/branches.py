# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A step that starts at, lands on, or passes next to a singular position.

The rule of integration is the classical one of Runge and Kutta, whatever the scene's, with every
stage put onto the mechanism's branch. So no stage is off the closures, where rows next to a
crossing do not determine the branch, and a stage's terms have only an interpolation's error. The
step is divided until its energy account closes.

The module also finds which branch the motion takes at a singular position.

Where closures lose rank, several branches of the mechanism's motion cross, and to first order it is
free to move between them as well. An acceleration found there leads off all of them; put back onto
the closures row by row, the mechanism may end on a branch that no force drives, or stop where the
branches meet. Of all branches Gauss's principle of least constraint picks the one nearest to the
free motion in the mass metric (T10 of docs/derivations.md): the motion's part along it stays, and
so the work done is the energy gained.

Points beside the crossing determine a branch. Where branches cross, and within rounding of that,
the closures' rows do not determine which directions are along a branch: an error of φ turns them by
φ/σ². The branch itself is smooth there. Its points, the projection P onto its tangents in the mass
metric, and the acceleration Ṗ v that keeps a motion on it, are smooth functions along it, and
beside the crossing the rows give them. Their values at the crossing follow by interpolation of
degree 5 between three points on each side (T10b of docs/derivations.md).

It also groups the coordinates that closures move into independent loops.

A closure is about the joints on the path from one of its frames to the other, a coupling about its
two joints. Closures that share none of these have nothing to do with each other, and nothing else
changes φ: a branch of the motion is one of these coordinates, independently of the others.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from typing import NamedTuple

import numpy as np

from hapticmech_ros.errors import ClosureError
from hapticmech_ros.mechanism.closures import Active
from hapticmech_ros.mechanism.constraint_space import Closing, ConstraintSpace, solve_lower
from hapticmech_ros.mechanism.kernels.energy_kernels import Balance
from hapticmech_ros.mechanism.mechanism import Mechanism
from hapticmech_ros.mechanism.motion import ExternalWrenches, Rates, Start, Stepped, rates_at
from hapticmech_ros.mechanism.projection import Projected, project, refuse_flipped, refuse_open
from hapticmech_ros.mechanism.refinement import least_off
from hapticmech_ros.mechanism.schemes import SCHEMES
from hapticmech_ros.mechanism.tolerances import DETERMINED, SINGULAR, SOLVER_RANK_TOLERANCE
from hapticmech_ros.numerics import Array


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
        """Return a change (nv,) of these coordinates alone, rad or m.

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
        """Return the length of a change in the mass metric, minimised over other coordinates.

        Others move along with these: minₓ |Lᵀ (change + x)| over x that do not move these.

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


# Places of the points, in multiples of the distance between two of them, and their weights.
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
        """Return Ṗ v (nv,), rad/s² or m/s², which keeps a motion on the branch.

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

    It is searched beside q along the loops' coordinates alone: motion of others, however fast, does
    not change their directions.

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


def _without_determined(space: ConstraintSpace, columns: Array) -> Array:
    """Return ``columns`` (nv,) without the directions of well determined closures.

    Args:
        space: the closures' terms.
        columns: (nv,) in the mass metric.
    """
    sigma = space.sigma
    if not sigma.size:
        return columns
    basis = space.basis[:, sigma > SINGULAR * sigma[0]]
    return np.asarray(columns - basis @ (basis.T @ columns))


def _directions(space: ConstraintSpace, change: Array) -> Iterator[Array]:
    """Yield directions (nv,) that are free to first order, the change itself first."""
    yield change
    size = change.size
    # No two of them are alike, and none is singled out by the mechanism.
    for k in range(1, 1 + min(TRIES * (size - space.rank + 1), MOST_TRIES)):
        anywhere = np.cos(np.sqrt(2.0) * k * np.arange(1.0, size + 1.0) ** 2)
        yield space.from_mass_metric(_without_determined(space, anywhere))


def _branch_towards(
    mechanism: Mechanism, q: Array, active: Active, space: ConstraintSpace, direction: Array
) -> tuple[ConstraintSpace, bool] | None:
    """Return the closures' terms after a small motion, projected onto the closures.

    Also return whether it was nearly on them before: where a branch stays singular, some directions
    seem free although no branch has them.
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


# Parts of the step move no joint of a loop next to a singular position further, rad, or m over the
# length...
LARGEST_PART = 5e-3
# ...and are halved until the energy account of the step closes to this share of the kinetic energy
# and of the energy exchanged; or so many times.
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
        free, space = self._free_rates(q, v).acceleration, closing.space
        moved = space.factor.T @ (step * v + 0.5 * step**2 * free)
        change = space.from_mass_metric(_without_determined(space, moved))
        self._rank = closing.rank
        self._direction, self.has_branch = change, True
        beside, loops = None, loops_of(mechanism, start.active)
        # By which each of the loops moves alike, as the change turns it.
        away = np.zeros(v.size)
        for one in loops:
            span = one.span(change)
            if span > 0.0:
                away += one.part(change) * (2.0 * REACH / span)
        if away.any():
            with suppress(ClosureError):
                there = mechanism.integrate(q, away)
                beside = project(mechanism, there, np.zeros(v.size), start.active).closing
                self._rank = max(self._rank, beside.rank)
        self._loops = near_singular(mechanism, loops, closing, beside)
        self.span = self._loops.span(change)
        if self._is_near(closing):
            found = nearest_branch(mechanism, q, start.active, space, change, self._loops)
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
        branch = self._branch(q, mechanism.closing_terms(q, active))
        if branch is None:
            q, v, _, closing = project(mechanism, q, v, active)
            branch = self._branch(q, closing)
        if branch is None:
            regular = Start(q, v, active, closing=closing)
            return _Stage(q, v, rates_at(mechanism, regular, self._external), closing)
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
        branch, space = self._branch(q, closing) if self.has_branch else None, closing.space
        if branch is None:
            return None
        along = [
            branch.closed_rates(space.from_mass_metric(one)) for one in np.eye(len(space.factor))
        ]
        return np.asarray(space.factor.T @ np.array(along).T)

    def _branch(self, q: Array, closing: Closing) -> Branch | None:
        """Return the branch next to q; None where rows determine it, or there is none."""
        if not self._is_near(closing):
            return None
        return branch_along(
            self._mechanism, q, self._active, closing.space, self._direction, self._loops
        )

    def _is_near(self, closing: Closing) -> bool:
        """Return whether the rows do not determine the branch, or barely."""
        return closing.rank < self._rank or closing.space.least_kept < SINGULAR

    def _free_rates(self, q: Array, v: Array) -> Rates:
        """Return the rates and powers without closures."""
        return rates_at(self._mechanism, Start(q, v, self._open), self._external)


def branch_step(
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
    outcomes: list[tuple[Stepped, Balance]] = []
    for halving in range(HALVINGS + 1):
        stepped = _in_parts(mechanism, motion, first, step, 2**halving * parts)
        balance = balance_of(stepped)
        outcomes.append((stepped, balance))
        if balance.is_within(ACCOUNT_TOLERANCE):
            break
    best, _ = least_off(outcomes)
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
    """Return the end of a step by the classical rule of order 4, and the exchange (3,), J.

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
