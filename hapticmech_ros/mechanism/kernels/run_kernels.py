# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Steps of the mechanism by one kernel, one or many."""

from __future__ import annotations

import numpy as np

from hapticmech_ros.compilation import inner, kernel, local, put
from hapticmech_ros.mechanism.kernels.energy_kernels import (
    BALANCE_SIZE,
    Balance,
    allowed,
    pushed_energy,
    put_balance,
)
from hapticmech_ros.mechanism.kernels.factor_kernels import SINGULAR, factor
from hapticmech_ros.mechanism.kernels.model import Data, Model, RunPlan, Work
from hapticmech_ros.mechanism.kernels.settle_kernels import SETTLED, settle
from hapticmech_ros.mechanism.kernels.step_kernels import (
    aim,
    aim_by_all,
    aim_implicitly,
    find_rates,
    linearise,
    start_step,
)
from hapticmech_ros.mechanism.tolerances import NEAR, PASSING, ROUNDED_STEPS
from hapticmech_ros.numerics import Array
from hapticmech_ros.numerics.small_matrices import dot, largest

# A run ended before a step that starts at, lands on, or would leave a singular position, or has a
# stage next to one.
SINGULAR_STEP = 10
# A run ended before a step whose energy account, or the account since the start with its surplus,
# would be off by more than allowed.
INACCURATE = 11
# Which of these a step checks: none, or all.
UNCHECKED, EVERYTHING = 0, 1
# A failure in a stage rather than at the end: rates that are not finite.
RATES_NOT_FINITE = -1_000_001


@inner
def _advance(
    model: Model,
    start: Data,
    known: bool,
    stage_space: Data,
    end: Data,
    parts: Work,
    external: Array,
    stages: int,
    implicit: bool,
    limit: float,
) -> int:
    """Do a step from ``parts.q0`` and ``parts.v0``; see :func:`advance`.

    It is not done where a stage is nearer than ``limit`` (relative σ) to a singular position.
    """
    result, data = model.result, start
    start_step(parts)
    for stage in range(stages):
        if not np.isfinite(dot(parts.v, parts.v)):
            return RATES_NOT_FINITE
        data = start if stage == 0 else stage_space
        if stage > 0 or not known:
            code = factor(model, parts.q, data)
            if code < 0:
                return code
        if stage > 0 and limit > 0.0 and _is_near(start, data, limit):
            return SINGULAR_STEP
        if implicit and stage == 0:
            bad = linearise(model, start, parts)
            if bad >= 0:
                return SINGULAR - bad
        weight = parts.scheme[stage, 0]
        find_rates(model, data, parts, weight, external, result)
        if implicit:
            aim_implicitly(model, start, parts, stage, result[: model.nv])
        elif model.turns.size > 0:
            aim_by_all(model, parts, stage, result)
        else:
            aim(model, parts, weight, parts.scheme[stage, 1], result)
    return settle(model, data, end, parts)


@inner
def _singular_limit(parts: Work) -> float:
    """Return the relative σ below which the next step is singular: see ``PASSING``."""
    return float(max(NEAR, min(PASSING, parts.settings.step * largest(parts.v0))))


@inner
def starts_near(first: Data, parts: Work) -> bool:
    """Return whether a step starts too near a singular position."""
    return bool(
        parts.settings.singularity_checks != UNCHECKED
        and first.tail.least_sigma < _singular_limit(parts)
    )


@inner
def _is_near(start: Data, data: Data, limit: float) -> bool:
    """Return whether a stage is next to a singular position, or of lower rank than the start."""
    rank, sigma = int(data.tail.rank), data.sigma
    if rank < start.tail.rank:
        return True
    if sigma.size == 0:
        return bool(data.tail.least_sigma < limit)
    return bool(rank > 0 and sigma[rank - 1] < limit * sigma[0])


@inner
def _lands_near(first: Data, last: Data, limit: float) -> bool:
    """Return whether a step ends next to a singular position, or began at one that it left."""
    left = last.tail.resolved_rank > first.tail.resolved_rank
    return bool(left or last.tail.rank < first.tail.rank or last.tail.least_sigma < limit)


@inner
def begin_next(parts: Work) -> None:
    """Make a step's end the start of the next one."""
    put(parts.q0, parts.q)
    put(parts.v0, parts.v)


@inner
def step_once(
    model: Model,
    first: Data,
    known: bool,
    stage_space: Data,
    last: Data,
    parts: Work,
    external: Array,
    stages: int,
    implicit: bool,
) -> int:
    """Do a step with the checks of ``parts.settings``; a refused one leaves no account.

    Args:
        model: the mechanism's.
        first: terms at the start, filled if ``known``.
        known: whether they are.
        stage_space: terms of stages.
        last: terms at the end, to fill.
        parts: see :class:`Work`.
        external: wrenches on links.
        stages: of the rule.
        implicit: whether it is an implicit one.

    Returns:
        See :func:`advance`.
    """
    heeded, limit, account = parts.settings.singularity_checks != UNCHECKED, 0.0, parts.account
    if heeded:
        if not known:
            code = factor(model, parts.q0, first)
            if code < 0:
                return code
            known = True
        limit = _singular_limit(parts)
        if first.tail.least_sigma < limit:
            return SINGULAR_STEP
    work_in, lost, by_contacts = account.work_in, account.energy_lost, account.contact_work
    code = _advance(
        model,
        first,
        known,
        stage_space,
        last,
        parts,
        external,
        stages,
        implicit,
        limit,
    )
    if heeded and code == SETTLED and _lands_near(first, last, limit):
        code = SINGULAR_STEP
    if code == SETTLED and parts.settings.energy_tolerance > 0.0:
        gained, taken = account.work_in - work_in, account.energy_lost - lost
        code = _watched(model, first, last, parts, external, implicit, gained, taken)
    if code == SETTLED:
        account.steps_done += 1.0
    else:
        account.work_in, account.energy_lost, account.contact_work = work_in, lost, by_contacts
    return code


@inner
def _watched(
    model: Model,
    first: Data,
    last: Data,
    parts: Work,
    external: Array,
    implicit: bool,
    work_in: float,
    lost: float,
) -> int:
    """Return SETTLED, or INACCURATE for a step whose energy account is off by too much.

    Also INACCURATE where the steps so far and this one together made too much energy from nothing.
    Energy that they lost without a cause cannot be restored: steps after which that is too much are
    counted.
    """
    account, tolerance = parts.account, parts.settings.energy_tolerance
    found = Balance(local(BALANCE_SIZE))
    put_balance(model, first, last, parts, implicit, work_in, lost, found)
    judged, exchanged, rounding = found.judged, found.exchanged, found.rounding
    if not judged <= allowed(tolerance, exchanged, rounding):
        exchanged += pushed_energy(model, first, parts, external)
        if not judged <= allowed(tolerance, exchanged, rounding):
            return INACCURATE
    moved = max(account.largest_kinetic, found.kinetic)
    account.energy_lost += found.lost - lost
    surplus = account.earlier_defect + account.energy_defect + found.off
    work = account.earlier_work + account.work_in - account.contact_work
    losses = account.earlier_loss + account.energy_lost
    exchanged = abs(work) + losses + moved
    most = allowed(parts.settings.drift_tolerance, exchanged, ROUNDED_STEPS * rounding)
    if surplus > most:
        return INACCURATE
    if -surplus > most:
        account.lossy_steps += 1.0
    account.energy_defect += found.off
    account.largest_kinetic = moved
    return SETTLED


@kernel(
    "int64(int64[::1], float64[::1], float64[::1], float64[::1], float64[::1], float64[::1],"
    " float64[:,::1], float64[:,::1], int64[::1])",
    linked=True,
)
def advance(
    numbers: Array,
    values: Array,
    start: Array,
    end: Array,
    scratch: Array,
    work: Array,
    external: Array,
    samples: Array,
    plan: Array,
) -> int:
    """Do one step or many, with pushes held.

    Args:
        numbers: (integers,) constants of the mechanism, whole ones.
        values: (numbers,) the others; see ``model.pack``.
        start: (size,) packed terms at the start: to read where they are known, else to fill.
        end: (size,) packed terms, to fill at the end.
        scratch: (size,) packed terms of stages.
        work: (work,) see :class:`Work`; ``q0`` and ``v0`` are the start, ``state`` the end, and the
            account adds up.
        external: (pushes, 10) wrenches on links; see ``motion_kernels.add_link_forces``.
        samples: (samples, nq + nv) to fill.
        plan: (7,) a :class:`~hapticmech_ros.mechanism.kernels.model.RunPlan`.

    Returns:
        0; SINGULAR_STEP before a step that starts at, lands on, or would leave a singular position,
        or has a stage next to one, and INACCURATE before one whose energy account would be off by
        too much, where ``q0`` and ``v0`` are its start and no terms are left; or how the step
        failed, see ``settle`` and ``factor``, and RATES_NOT_FINITE. The account has the number of
        steps done.
    """
    model, parts, run = Model(numbers, values), Work(numbers, work), RunPlan(plan)
    steps, every, stages = run.steps, run.sample_every, run.stages
    implicit, known = run.implicit != 0, run.terms_known != 0
    first, last, stage_space = (
        Data(model.numbers, start),
        Data(model.numbers, end),
        Data(model.numbers, scratch),
    )
    state, sampled = parts.state, 0
    for step in range(steps):
        if step > 0:
            begin_next(parts)
            first, last, known = last, first, True
        code = step_once(model, first, known, stage_space, last, parts, external, stages, implicit)
        if code != SETTLED:
            if step % 2 == 1:
                put(end, start)
            return code
        if every > 0 and (step + 1) % every == 0:
            put(samples[sampled], state)
            sampled += 1
    if steps % 2 == 0:
        put(end, start)
    return SETTLED
