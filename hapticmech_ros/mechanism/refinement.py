# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Repeats a step in smaller ones until its energy account closes.

First it tries 2, 4, ... equal steps, for a step that is too long for the whole motion. An account
that just closes belongs to a step that is just accurate enough: where halving pays, steps are
halved further, until the account closes to a hundredth of the tolerance. If equal steps do not
help, it tries as many steps of other lengths: short where the accounts of the equal ones are off,
as where a motion turns suddenly somewhere in the step (a mesh that equidistributes an error, see de
Boor, "Good approximation by splines with variable knots II", 1974).

If a kernel could not end a step at all, its reason becomes an error here.

It also judges the error of a step's energy account.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from types import SimpleNamespace
from typing import NamedTuple, cast

import numpy as np

from hapticmech_ros.errors import HapticMechError
from hapticmech_ros.mechanism.closures import Active
from hapticmech_ros.mechanism.constraint_space import failure
from hapticmech_ros.mechanism.inertia import diverged, inaccurate
from hapticmech_ros.mechanism.kernels.energy_kernels import Balance
from hapticmech_ros.mechanism.kernels.factor_kernels import NOT_FINITE
from hapticmech_ros.mechanism.kernels.model import tail_of
from hapticmech_ros.mechanism.kernels.run_kernels import RATES_NOT_FINITE
from hapticmech_ros.mechanism.kernels.settle_kernels import FLIPPED, JUMPED, OPEN
from hapticmech_ros.mechanism.mechanism import Mechanism
from hapticmech_ros.mechanism.model import TreeModel
from hapticmech_ros.mechanism.motion import EarlierAccount, Start, Stepped, end_of, not_finite
from hapticmech_ros.mechanism.projection import came_apart, flipped, jumped
from hapticmech_ros.mechanism.tolerances import ROUNDED_STEPS
from hapticmech_ros.numerics import Array

# A step that is off by this share of what it exchanged, however it is divided, is an error.
FAILURE = 0.1


def judged(
    tree: TreeModel,
    start: Start,
    stepped: Stepped,
    balance: Balance,
    tolerance: float,
    most: float,
) -> Stepped:
    """Return a step with its account; without energy made from nothing, if that is too much.

    If the step, or all since the start, made too much, all of it is taken out of the motion.

    Args:
        tree: the mechanism's.
        start: of the step.
        stepped: its result.
        balance: its account.
        tolerance: share of the energy exchanged by which it may be off.
        most: share of the energy exchanged that all steps may make from nothing.

    Raises:
        InaccurateStepError: it is off by a tenth of the energy exchanged.
    """
    within, made = balance.is_within(tolerance), 0.0
    if not within:
        if balance.judged > FAILURE * balance.exchanged:
            raise inaccurate(tree, stepped.v - start.v, balance.off, balance.exchanged)
        made = min(balance.made, balance.kinetic)
    surplus, kinetic = balance.off - made, balance.kinetic - made
    drifts = drift(start.earlier, stepped, surplus, balance, most)
    drifted = min(max(drifts, 0.0), kinetic)
    taken = made + drifted
    share = math.sqrt(1.0 - taken / balance.kinetic) if taken > 0.0 else 1.0
    return stepped._replace(
        v=share * stepped.v if taken > 0.0 else stepped.v,
        energy_lost=balance.lost,
        surplus=surplus - drifted,
        refined=1,
        inaccurate=int(not within or drifts != 0.0),
        moved=kinetic - drifted,
    )


def drift(
    earlier: EarlierAccount, stepped: Stepped, surplus: float, balance: Balance, most: float
) -> float:
    """Return the steps' surplus since the start, negative if lost, J, if it is too much; else 0.

    Args:
        earlier: account before the step.
        stepped: its result.
        surplus: that is left of the step, J.
        balance: its account.
        most: largest share of the energy exchanged that is not too much.
    """
    work, lost = earlier.work_in + stepped.work_in, earlier.lost + balance.lost
    total = earlier.surplus + surplus
    exchanged = abs(work) + lost + max(earlier.moved, balance.kinetic)
    within = abs(total) <= most * exchanged + ROUNDED_STEPS * balance.rounding
    return 0.0 if within else total


def step_error(
    mechanism: Mechanism,
    parts: SimpleNamespace,
    code: int,
    packed: Array,
    active: Active,
) -> HapticMechError:
    """Return the error of a step.

    Args:
        mechanism: that was stepped.
        parts: of the work; see ``model.Work``.
        code: how the step failed; see ``run_kernels.advance``.
        packed: (size,) terms at its end.
        active: per closure, whether it is closed.
    """
    worst, names = tail_of(packed).largest_residual, mechanism.names_of(active)
    if code == OPEN:
        return came_apart(worst, names)
    if code == JUMPED:
        return jumped(
            float(np.divide(parts.account.projection_length, parts.account.step_length)), names
        )
    if code == FLIPPED:
        wrong = [i for i, on in enumerate(active) if on and mechanism.on_wrong_branch(i, parts.q)]
        return flipped(worst, [mechanism.closures[i].name for i in wrong[:1]] or names)
    if code == RATES_NOT_FINITE:
        return not_finite("rates", parts.v)
    if code == NOT_FINITE:
        return not_finite("state", parts.q)
    return _diverged(mechanism, parts) or failure(code, mechanism.tree)


def _diverged(mechanism: Mechanism, parts: SimpleNamespace) -> HapticMechError | None:
    """Return the error of a step that diverged, if its start is regular."""
    none = tuple(False for _ in mechanism.closures)
    try:
        mechanism.closing_terms(parts.q0, none)
    except HapticMechError:
        return None
    moved = mechanism.difference(parts.q0, parts.q)
    return diverged(mechanism.tree, moved, parts.settings.step)


# Lengths of steps are set anew so many times.
MESHES = 3
# Steps whose account closes are halved until it closes to this share of the tolerance, as long as
# that makes it so many times better, as it does in a rule of order 4 that resolves the motion.
CLOSER, PAYS = 0.01, 8.0
# An account that is off by E requires steps shorter by this power of E, and this share of the steps
# is spread evenly whatever the accounts are.
GRADING, EVEN = 0.25, 0.25


class Ways(NamedTuple):
    """How a step can be done.

    Attributes:
        divided: returns the state after it, done in so many steps of equal length.
        part: returns the state after such a share of it, from any start.
        balance: returns the energy account from a start.
    """

    divided: Callable[[int], Stepped]
    part: Callable[[Start, float], Stepped]
    balance: Callable[[Start, Stepped], Balance]


def refined(start: Start, tolerance: float, most: int, ways: Ways) -> tuple[Stepped, Balance]:
    """Return the state after a step whose energy account is off by least, and the account.

    Args:
        start: of the step.
        tolerance: share of the energy exchanged by which a step's account may be off.
        most: largest number of smaller steps.
        ways: to do it.

    Raises:
        HapticMechError: it fails however small the steps are, as it does in one.
    """
    outcomes: list[tuple[Stepped, Balance]] = []
    best: Balance | None = None
    failed, count = None, 1
    while count <= most and not (best and best.is_within(CLOSER * tolerance)):
        before = best
        try:
            stepped = ways.divided(count)
            outcomes.append((stepped, ways.balance(start, stepped)))
            _, best = least_off(outcomes)
        except HapticMechError as error:
            failed = failed or error
        closed = before if before and before.is_within(tolerance) else None
        if closed and best and PAYS * best.judged > closed.judged:
            break
        count *= 2
    if not outcomes:
        raise cast(HapticMechError, failed)
    mesh = np.linspace(0.0, 1.0, most + 1)
    for _ in range(MESHES if most > 1 else 0):
        if least_off(outcomes)[1].is_within(tolerance):
            break
        try:
            stepped, off = _along(mesh, start, ways)
            outcomes.append((stepped, ways.balance(start, stepped)))
        except HapticMechError:
            break
        if not np.isfinite(off).all():
            break
        mesh = equidistributed(mesh, off)
    return least_off(outcomes)


def least_off(outcomes: Sequence[tuple[Stepped, Balance]]) -> tuple[Stepped, Balance]:
    """Return the outcome whose account is off by least, the first one of equals."""
    return min(outcomes, key=lambda outcome: outcome[1].judged)


def _along(mesh: Array, start: Start, ways: Ways) -> tuple[Stepped, Array]:
    """Return the state after steps between the points of a mesh, and each step's error."""
    now, ended, off = start, None, []
    for share in np.diff(mesh).tolist():
        stepped = ways.part(now, share)
        off.append(ways.balance(now, stepped).judged)
        ended = stepped if ended is None else stepped.after(ended)
        now = end_of(stepped, now)
    return cast(Stepped, ended), np.array(off)


def equidistributed(mesh: Array, off: Array) -> Array:
    """Return the mesh on which the errors of steps would be alike.

    Args:
        mesh: (n + 1,) increasing, from 0 to 1.
        off: (n,) error of the step from each point to the next.

    Returns:
        (n + 1,) increasing, from 0 to 1.
    """
    wanted = off**GRADING
    total = float(wanted.sum())
    lengths = np.diff(mesh)
    share = EVEN * lengths + ((1.0 - EVEN) * wanted / total if total > 0.0 else 0.0)
    reached = np.concatenate(([0.0], np.cumsum(share / share.sum())))
    found = np.interp(np.linspace(0.0, 1.0, mesh.size), reached, mesh)
    found[0], found[-1] = 0.0, 1.0
    return np.asarray(found)
