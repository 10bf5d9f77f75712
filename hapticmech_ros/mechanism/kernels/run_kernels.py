# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Steps of the mechanism by one kernel, one or many."""

from __future__ import annotations

import numpy as np

from hapticmech_ros.compilation import inner, kernel, local, put
from hapticmech_ros.mechanism.kernels.energy_kernels import (
    BALANCE,
    EXCHANGED,
    JUDGED,
    KINETIC,
    LOST,
    OFF,
    ROUNDING,
    allowed,
    pushed_energy,
    put_balance,
)
from hapticmech_ros.mechanism.kernels.factor_kernels import SINGULAR, factor
from hapticmech_ros.mechanism.kernels.model import (
    CONTACT_WORK,
    DRIFT,
    ENERGY_LOST,
    HEEDED,
    IMPLICIT,
    LEAST,
    LOSSY,
    MOVED,
    OWED_LOSS,
    OWED_SURPLUS,
    OWED_WORK,
    RANK,
    RESOLVED_RANK,
    SAMPLE_EVERY,
    STAGES,
    STEP,
    STEPS,
    STEPS_DONE,
    SURPLUS,
    TERMS_KNOWN,
    TOLERANCE,
    WORK_IN,
    Data,
    Model,
    unpack,
)
from hapticmech_ros.mechanism.kernels.settle_kernels import SETTLED, settle
from hapticmech_ros.mechanism.kernels.step_kernels import (
    Work,
    aim,
    aim_by_all,
    aim_implicitly,
    find_rates,
    linearise,
    start_step,
)
from hapticmech_ros.mechanism.tolerances import NEAR, PASSING, ROUNDED_STEPS
from hapticmech_ros.numerics import Array
from hapticmech_ros.numerics.small_matrices import dot

# A run ended before a step that starts at, lands on, or would leave a singular position, or has a
# stage next to one.
NEEDS_CARE = 10
# Before a step whose energy account would be off by more than is allowed, or with whose surplus the
# account since the start would.
INACCURATE = 11
# What a step heeds of that: nothing, or all of it.
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
    spring_work: Array,
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
            return NEEDS_CARE
        if implicit and stage == 0:
            bad = linearise(model, start, parts, spring_work)
            if bad >= 0:
                return SINGULAR - bad
        weight = parts.scheme[stage, 0]
        find_rates(model, data, parts, weight, external, result)
        if implicit:
            aim_implicitly(model, start, parts, spring_work, stage, result[: model.nv])
        elif spring_work.size > 0:
            aim_by_all(model, parts, spring_work, stage, result)
        else:
            aim(model, parts, weight, parts.scheme[stage, 1], result)
    return settle(model, data, end, parts)


@inner
def _care_limit(parts: Work) -> float:
    """Return the relative σ below which the next step needs care: see ``PASSING``."""
    fastest, v0 = 0.0, parts.v0
    for c in range(v0.size):
        fastest = max(fastest, abs(v0[c]))
    return float(max(NEAR, min(PASSING, parts.settings[STEP] * fastest)))


@inner
def starts_near(first: Data, parts: Work) -> bool:
    """Return whether a step starts so near a singular position that it needs care."""
    return bool(parts.settings[HEEDED] != UNCHECKED and first.tail[LEAST] < _care_limit(parts))


@inner
def _is_near(start: Data, data: Data, limit: float) -> bool:
    """Return whether a stage is next to a singular position, or of lower rank than the start."""
    rank, sigma = int(data.tail[RANK]), data.sigma
    if rank < start.tail[RANK]:
        return True
    if sigma.size == 0:
        return bool(data.tail[LEAST] < limit)
    return bool(rank > 0 and sigma[rank - 1] < limit * sigma[0])


@inner
def _lands_near(first: Data, last: Data, limit: float) -> bool:
    """Return whether a step ends next to a singular position, or began at one that it left."""
    left = last.tail[RESOLVED_RANK] > first.tail[RESOLVED_RANK]
    return bool(left or last.tail[RANK] < first.tail[RANK] or last.tail[LEAST] < limit)


@inner
def begin_next(parts: Work) -> None:
    """Make a step's end the start of the next one."""
    q, q0, v, v0 = parts.q, parts.q0, parts.v, parts.v0
    for i in range(q.size):
        q0[i] = q[i]
    for i in range(v.size):
        v0[i] = v[i]


@inner
def step_once(
    model: Model,
    first: Data,
    known: bool,
    stage_space: Data,
    last: Data,
    parts: Work,
    spring_work: Array,
    external: Array,
    stages: int,
    implicit: bool,
) -> int:
    """Do a step as ``parts.settings`` says what it heeds; one that is not done leaves no account.

    Args:
        model: the mechanism's.
        first: terms at the start, filled if ``known``.
        known: whether they are.
        stage_space: terms of stages.
        last: terms at the end, to fill.
        parts: see :class:`Work`.
        spring_work: of implicit rules.
        external: wrenches on links.
        stages: of the rule.
        implicit: whether it is an implicit one.

    Returns:
        See :func:`advance`.
    """
    heeded, limit, account = parts.settings[HEEDED] != UNCHECKED, 0.0, parts.account
    if heeded:
        if not known:
            code = factor(model, parts.q0, first)
            if code < 0:
                return code
            known = True
        limit = _care_limit(parts)
        if first.tail[LEAST] < limit:
            return NEEDS_CARE
    work_in, lost, by_contacts = account[WORK_IN], account[ENERGY_LOST], account[CONTACT_WORK]
    code = _advance(
        model,
        first,
        known,
        stage_space,
        last,
        parts,
        spring_work,
        external,
        stages,
        implicit,
        limit,
    )
    if heeded and code == SETTLED and _lands_near(first, last, limit):
        code = NEEDS_CARE
    if code == SETTLED and parts.settings[TOLERANCE] > 0.0:
        gained, taken = account[WORK_IN] - work_in, account[ENERGY_LOST] - lost
        code = _watched(model, first, last, parts, external, implicit, gained, taken)
    if code == SETTLED:
        account[STEPS_DONE] += 1.0
    else:
        account[WORK_IN], account[ENERGY_LOST], account[CONTACT_WORK] = work_in, lost, by_contacts
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

    So it is as well where the steps so far and this one together made too much from nothing. What
    they lost without a cause cannot be given back: steps after which that is too much are counted.
    """
    account, tolerance, found = parts.account, parts.settings[TOLERANCE], local(BALANCE)
    put_balance(model, first, last, parts, implicit, work_in, lost, found)
    judged, exchanged, rounding = found[JUDGED], found[EXCHANGED], found[ROUNDING]
    if not judged <= allowed(tolerance, exchanged, rounding):
        exchanged += pushed_energy(model, first, parts, external)
        if not judged <= allowed(tolerance, exchanged, rounding):
            return INACCURATE
    moved = max(account[MOVED], found[KINETIC])
    account[ENERGY_LOST] += found[LOST] - lost
    surplus = account[OWED_SURPLUS] + account[SURPLUS] + found[OFF]
    work = account[OWED_WORK] + account[WORK_IN] - account[CONTACT_WORK]
    losses = account[OWED_LOSS] + account[ENERGY_LOST]
    exchanged = abs(work) + losses + moved
    most = allowed(parts.settings[DRIFT], exchanged, ROUNDED_STEPS * rounding)
    if surplus > most:
        return INACCURATE
    if -surplus > most:
        account[LOSSY] += 1.0
    account[SURPLUS] += found[OFF]
    account[MOVED] = moved
    return SETTLED


@kernel(
    "int64(int64[::1], float64[::1], float64[::1], float64[::1], float64[::1], float64[::1],"
    " float64[::1], float64[:,::1], float64[:,::1], int64[::1])",
    linked=True,
)
def advance(
    numbers: Array,
    values: Array,
    start: Array,
    end: Array,
    scratch: Array,
    work: Array,
    spring_work: Array,
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
        spring_work: (``springs_size(nv)``,) of an implicit rule, else (0,); see ``Springs``.
        external: (pushes, 10) wrenches on links; see ``motion_kernels.add_link_forces``.
        samples: (samples, nq + nv) to fill.
        plan: (7,) see ``step_layout.RUN_PLAN``.

    Returns:
        0; NEEDS_CARE before a step that starts at, lands on, or would leave a singular position, or
        has a stage next to one, and INACCURATE before one whose energy account would be off by too
        much, where ``q0`` and ``v0`` are its start and no terms are left; or how the step failed,
        see ``settle`` and ``factor_closures``, and RATES_NOT_FINITE. The account says how many
        steps were done.
    """
    model, parts = Model(numbers, values), Work(numbers, work)
    steps, every, stages = plan[STEPS], plan[SAMPLE_EVERY], plan[STAGES]
    implicit, known = plan[IMPLICIT] != 0, plan[TERMS_KNOWN] != 0
    first, last, stage_space = unpack(start, model), unpack(end, model), unpack(scratch, model)
    state, sampled = parts.state, 0
    for step in range(steps):
        if step > 0:
            begin_next(parts)
            first, last, known = last, first, True
        code = step_once(
            model, first, known, stage_space, last, parts, spring_work, external, stages, implicit
        )
        if code != SETTLED:
            if step % 2 == 1:
                put(end, start)
            return code
        if every > 0 and (step + 1) % every == 0:
            for i in range(state.size):
                samples[sampled, i] = state[i]
            sampled += 1
    if steps % 2 == 0:
        put(end, start)
    return SETTLED
