# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A period of a mechanism that touches things, in one call.

Forces at the points first, at the step's start and implicit in the rates at its end; then the
integrator's step with them held as wrenches on the links. See ``solver_kernels``. Points at a
period's start are kept, in case it is not completed.
"""

from __future__ import annotations

import numpy as np

from hapticmech_ros.compilation import inner, kernel, local, put
from hapticmech_ros.contact.layout import JOINT_A, JOINT_B, NOTHING, SHAPE_A, Contacts
from hapticmech_ros.contact.solver_kernels import contact_forces
from hapticmech_ros.contact.touch_kernels import (
    near_pairs,
    needs_search,
    place_shapes,
    put_point,
    touching_points,
)
from hapticmech_ros.mechanism.kernels.band_kernels import NOT_DECIDED
from hapticmech_ros.mechanism.kernels.factor_kernels import factor
from hapticmech_ros.mechanism.kernels.manifold_kernels import move
from hapticmech_ros.mechanism.kernels.model import Data, Model, RunPlan, StepAccount, Work
from hapticmech_ros.mechanism.kernels.run_kernels import (
    INACCURATE,
    RATES_NOT_FINITE,
    SINGULAR_STEP,
    begin_next,
    starts_near,
    step_once,
)
from hapticmech_ros.mechanism.kernels.settle_kernels import SETTLED
from hapticmech_ros.mechanism.kernels.step_kernels import find_rates, start_step
from hapticmech_ros.mechanism.kernels.tree_kernels import place_tree
from hapticmech_ros.numerics import Array
from hapticmech_ros.numerics.small_matrices import add_scaled, cross, dot, largest, put3, subtract3


@inner
def keep(contacts: Contacts) -> None:
    """Keep points and forces as they are."""
    n = contacts.counts.points
    put(contacts.kept_counts.values, contacts.counts.values)
    put(contacts.kept_owners[:n], contacts.owners[:n])
    put(contacts.kept_points[:n], contacts.points[:n])
    put(contacts.kept_forces[:n], contacts.forces[:n])
    put(contacts.kept_origins[:n], contacts.origins[:n])
    put(contacts.kept_joint_force, contacts.joint_force)
    put(contacts.kept_report.values, contacts.report.values)


@inner
def restore(contacts: Contacts) -> None:
    """Put points and forces back as they were kept."""
    found, n = contacts.counts.points_found, contacts.kept_counts.points
    put(contacts.counts.values, contacts.kept_counts.values)
    contacts.counts.points_found = found
    put(contacts.owners[:n], contacts.kept_owners[:n])
    put(contacts.points[:n], contacts.kept_points[:n])
    put(contacts.forces[:n], contacts.kept_forces[:n])
    put(contacts.origins[:n], contacts.kept_origins[:n])
    put(contacts.joint_force, contacts.kept_joint_force)
    put(contacts.report.values, contacts.kept_report.values)


@inner
def contact_effects(contacts: Contacts, places: Array, count: int) -> None:
    """Fill ``step_force``, ``origins`` and the links' rows of ``external``.

    Args:
        contacts: with so many points and the forces there.
        places: (joints, 12) poses of the joints at the step's start.
        count: number of points.
    """
    moment, force, axes, moves = local(3), contacts.step_force, contacts.axes, contacts.moves
    points, forces, owners = contacts.points, contacts.forces, contacts.owners
    pairs, poses, origins = contacts.pairs, contacts.poses, contacts.origins
    force[:] = 0.0
    for c in range(count):
        pair = pairs[owners[c]]
        cross(points[c], forces[c], moment)
        put3(origins[c], poses[pair[SHAPE_A], 9:])
        for j in range(force.size):
            side = moves[pair[JOINT_A], j] - moves[pair[JOINT_B], j]
            if side != 0.0:
                for i in range(3):
                    force[j] += side * (axes[j, i] * forces[c, i] + axes[j, 3 + i] * moment[i])
    _push_links(contacts, places, count)


@inner
def _push_links(contacts: Contacts, places: Array, count: int) -> None:
    """Fill the links' rows of ``external``; see ``motion_kernels.add_link_forces``."""
    moment, arm, place = local(3), local(3), local(3)
    carriers, link_origins, acts = contacts.carriers, contacts.link_origins, contacts.acts
    points, forces, owners = contacts.points, contacts.forces, contacts.owners
    for link in range(carriers.size):
        push, origin = contacts.external[link], link_origins[link]
        push[0], push[4:] = carriers[link], 0.0
        put3(push[1:], origin)
        put_point(places[carriers[link]], origin[0], origin[1], origin[2], place)
        for c in range(count):
            sign = acts[link, owners[c]]
            if sign != 0.0:
                subtract3(points[c], place, arm)
                cross(arm, forces[c], moment)
                add_scaled(push[4:7], sign, forces[c])
                add_scaled(push[7:], sign, moment)


# Points are looked for this many steps ahead: forces begin half a step before surfaces meet.
STEPS_AHEAD = 1.5
# Rates at a step's end follow from accelerations at its start up to this turn in it, rad.
TURNS = 0.02
# Points count that are apart by this share of the shapes' size, moving or not.
SLACK = 1e-3
# A call begins with a period; a substep; or one whose nearest points have been found.
WHOLE, EACH, SEARCHED = 0, 1, 2
# Why a call ended early: nearest points have to be searched for; too small a workspace.
# Within a period: shapes may come near. A substep that has to be divided to resolve an impact. The
# forces in one whose end without contacts was known.
SEARCH, MORE_WORKSPACE, NEAR, IMPACT, FORCES = 20, 21, 22, 23, 24


@inner
def _untouched(
    model: Model,
    start: Array,
    end: Array,
    stage_space: Data,
    parts: Work,
    contacts: Contacts,
    plan: RunPlan,
    external: Array,
) -> int:
    """Do a period as if there were no contacts; return NEAR where it cannot be done so.

    NEAR is where shapes may come near in it, or a step is singular: all is as it was then. Terms at
    the end, or of a failure, are in ``end``.
    """
    q0, v0, account, begun = parts.q0, parts.v0, parts.account, contacts.begun
    substeps, stages, implicit = plan.steps, plan.stages, plan.implicit != 0
    first = Data(model.numbers, start)
    if plan.terms_known == 0:
        code = factor(model, q0, first)
        if code < 0:
            return code
    span, share = STEPS_AHEAD * contacts.settings.period, contacts.settings.far_share
    place_shapes(contacts, first)
    if near_pairs(contacts, v0, span, share) > 0:
        return NEAR
    put(begun[: q0.size], q0)
    put(begun[q0.size :], v0)
    before = StepAccount()
    put(before.values, account.values)
    one, other, code, odd = first, Data(model.numbers, end), SETTLED, False
    for step in range(substeps):
        odd = step % 2 == 1
        if step > 0:
            begin_next(parts)
            one, other = other, one
        code = step_once(model, one, True, stage_space, other, parts, external, stages, implicit)
        if code != SETTLED:
            break
    # External wrenches may have made it fast enough to come near after all.
    if code == SETTLED and near_pairs(contacts, parts.v, span, share) == 0:
        contacts.counts.points = 0
        if odd:
            put(end, start)
        return SETTLED
    if code not in (SETTLED, SINGULAR_STEP, INACCURATE, NOT_DECIDED):
        if odd:
            put(end, start)
        return code
    put(q0, begun[: q0.size])
    put(v0, begun[q0.size :])
    put(account.values, before.values)
    if substeps > 1:
        code = factor(model, q0, first)
        if code < 0:
            return code
    return NEAR


@inner
def _find_free(
    model: Model,
    first: Data,
    stage_space: Data,
    last: Data,
    parts: Work,
    contacts: Contacts,
    external: Array,
    stages: int,
    implicit: bool,
) -> int:
    """Fill ``free`` and ``q``, rates and place at the substep's end without contacts.

    They follow from the accelerations at its start; by an implicit rule, or where joints turn by
    more than ``TURNS``, from a step without contacts. ``stiff`` is by how much rates differ then
    from those that accelerations would give. Returns SETTLED, or how that failed, SINGULAR_STEP and
    NOT_DECIDED included.
    """
    free, result, v0, step = contacts.free, model.result, parts.v0, parts.settings.step
    change, stiff = contacts.change, contacts.stiff
    start_step(parts)
    if not np.isfinite(dot(parts.v, parts.v)):
        return RATES_NOT_FINITE
    find_rates(model, first, parts, 0.0, external, model.result)
    for c in range(free.size):
        free[c], stiff[c] = v0[c] + step * result[c], 0.0
        change[c] = 0.5 * step * (v0[c] + free[c])
    if implicit or step * largest(v0) > TURNS:
        account, settings, v = parts.account, parts.settings, parts.v
        before, tolerance = StepAccount(), settings.energy_tolerance
        put(before.values, account.values)
        settings.energy_tolerance = 0.0
        code = step_once(model, first, True, stage_space, last, parts, external, stages, implicit)
        settings.energy_tolerance = tolerance
        put(account.values, before.values)
        if code in (SINGULAR_STEP, NOT_DECIDED):
            return code
        if code == SETTLED:
            put(contacts.q, parts.q)
            for c in range(free.size):
                stiff[c] = free[c] - v[c] if implicit else 0.0
                free[c] = v[c]
            return SETTLED
    move(model, parts.q0, change, contacts.q)
    return SETTLED


@inner
def _approach(first: Data, step: float, contacts: Contacts) -> int:
    """Place the shapes, and look which of them are near; return SETTLED or SEARCH."""
    place_shapes(contacts, first)
    near = near_pairs(contacts, contacts.free, STEPS_AHEAD * step, SLACK)
    return SEARCH if near > 0 and needs_search(contacts) else SETTLED


@inner
def _remember(contacts: Contacts) -> None:
    """Keep points and forces of the substep before."""
    n = contacts.counts.points
    put(contacts.owners_before[:n], contacts.owners[:n])
    put(contacts.points_before[:n], contacts.points[:n])
    put(contacts.forces_before[:n], contacts.forces[:n])
    contacts.counts.points_before = n


@inner
def _guess(contacts: Contacts, count: int) -> None:
    """Fill ``forces`` with those of the substep before, at the nearest points of the same pairs."""
    points, forces, owners = contacts.points, contacts.forces, contacts.owners
    points_before, forces_before = contacts.points_before, contacts.forces_before
    owners_before, known = contacts.owners_before, contacts.counts.points_before
    same = known == count
    for k in range(count):
        same = same and owners[k] == owners_before[k]
    for k in range(count):
        best, least = k if same else -1, np.inf
        for j in range(0 if same else known):
            if owners_before[j] == owners[k]:
                away = 0.0
                for i in range(3):
                    away += (points_before[j, i] - points[k, i]) ** 2
                if away < least:
                    best, least = j, away
        for i in range(3):
            forces[k, i] = forces_before[best, i] if best >= 0 else 0.0


@inner
def _substep(
    model: Model,
    first: Data,
    known: bool,
    stage_space: Data,
    last: Data,
    parts: Work,
    contacts: Contacts,
    stages: int,
    implicit: bool,
    searched: bool,
    external_count: int,
) -> int:
    """Do a step of the integrator with contacts."""
    links, q0, v0, step = contacts.carriers.size, parts.q0, parts.v0, parts.settings.step
    external = contacts.external[links : links + external_count]
    is_known = contacts.settings.known != NOTHING
    if not searched:
        if not known:
            code = factor(model, q0, first)
            if code < 0:
                return code
        code = SETTLED
        if not is_known:
            _remember(contacts)
            if starts_near(first, parts):
                return SINGULAR_STEP
            code = _find_free(
                model,
                first,
                stage_space,
                last,
                parts,
                contacts,
                external,
                stages,
                implicit,
            )
        if code == SETTLED:
            code = _approach(first, step, contacts)
        if code != SETTLED:
            return code
    count = touching_points(contacts)
    counts, report = contacts.counts, contacts.report
    if 3 * count * (model.nv + 6 * count) > contacts.workspace.size:
        counts.points_found = count
        return MORE_WORKSPACE
    counts.points = count
    if contacts.settings.is_part == 0.0:
        counts.parts = 1
    report.values[:] = 0.0
    if count > 0:
        _guess(contacts, count)
        place_tree(model, contacts.q, stage_space)
        later = stage_space.joint_jacobian
        division = contact_forces(model, first, contacts, later, v0, step, count)
        if division > 1:
            counts.parts = division
            return IMPACT
        contact_effects(contacts, first.places, count)
        external = contacts.external[: links + external_count]
    if is_known:
        return FORCES
    parts.settings.contact_wrenches = links if count > 0 else 0
    code = step_once(model, first, True, stage_space, last, parts, external, stages, implicit)
    parts.settings.contact_wrenches = 0.0
    if code == SETTLED and count > 0:
        share = step / contacts.settings.period
        add_scaled(contacts.joint_force, share, contacts.step_force)
        counts.unsolved += int(report.failed)
    return code


@kernel(
    "i8(i8[::1], f8[::1], f8[::1], f8[::1], f8[::1], f8[::1], i8[::1], f8[::1], i8[::1])",
    linked=True,
)
def advance_period(
    numbers: Array,
    values: Array,
    start: Array,
    end: Array,
    scratch: Array,
    work: Array,
    contact_numbers: Array,
    contact_values: Array,
    plan: Array,
) -> int:
    """Do a period with contacts, or the rest of one.

    Args:
        numbers: (integers,) constants of the mechanism, whole ones.
        values: (numbers,) the others; see ``model.pack``.
        start: (size,) packed terms at the start: to read where they are known, else to fill.
        end: (size,) packed terms, to fill at the end.
        scratch: (size,) packed terms of stages.
        work: (work,) see ``model.Work``; ``q0`` and ``v0`` are the start, ``state`` the end,
            and the account adds up.
        contact_numbers: (integers,) of the contacts, whole ones.
        contact_values: (numbers,) the others; see ``layout.Contacts``.
        plan: (7,) a ``model.RunPlan`` that begins with ``WHOLE``, ``EACH`` or ``SEARCHED``.

    Returns:
        0 at the period's end; before a substep that is not done yet SEARCH, where ``found`` of the
        pairs near has to be filled, MORE_WORKSPACE, where the workspace for ``points_found`` points
        is missing, IMPACT, where the substep should be divided into ``parts`` parts, FORCES, where
        ``settings.known`` requests these alone, or SINGULAR_STEP, INACCURATE and NOT_DECIDED, as of
        ``run_kernels.advance``: ``q0`` and ``v0`` are its start then, and ``start`` has the terms
        there unless it is NOT_DECIDED. Points and forces are those of this substep where it is
        FORCES or INACCURATE. Or how a substep failed. The account has the number of substeps done.
    """
    model, parts, run = Model(numbers, values), Work(numbers, work), RunPlan(plan)
    contacts = Contacts(contact_numbers, contact_values)
    first, last, stage_space = (
        Data(model.numbers, start),
        Data(model.numbers, end),
        Data(model.numbers, scratch),
    )
    substeps, stages, known = run.steps, run.stages, run.terms_known != 0
    searched, implicit = run.begins_with == SEARCHED, run.implicit != 0
    external_count = run.external_wrenches
    if run.begins_with == WHOLE:
        links = contacts.carriers.size
        contacts.joint_force[:] = 0.0
        contacts.counts.parts, contacts.counts.unsolved = 1, 0
        external = contacts.external[links : links + external_count]
        code = _untouched(model, start, end, stage_space, parts, contacts, run, external)
        if code != NEAR:
            return code
        known = True
    for step in range(substeps):
        if step > 0:
            begin_next(parts)
            first, last, known, searched = last, first, True, False
        code = _substep(
            model,
            first,
            known,
            stage_space,
            last,
            parts,
            contacts,
            stages,
            implicit,
            searched,
            external_count,
        )
        if code != SETTLED:
            # Terms at this substep's start are where they are looked for, or those of the failure.
            if step % 2 == 1:
                if code >= SINGULAR_STEP:
                    put(start, end)
                else:
                    put(end, start)
            return code
    if substeps % 2 == 0:
        put(end, start)
    return SETTLED
