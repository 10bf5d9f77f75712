# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A step of the mechanism inside a kernel: the work that its parts share, and explicit stages.

The rules are those of :mod:`~hapticmech_ros.mechanism.schemes`.

Stages of the linearly implicit rule, see :mod:`~hapticmech_ros.mechanism.schemes`.
"""

from __future__ import annotations

import numpy as np

from hapticmech_ros.compilation import inner, local, put
from hapticmech_ros.mechanism.kernels.closure_kernels import (
    COUPLING,
    end_of_rows,
    gear_speed,
    pair_power,
)
from hapticmech_ros.mechanism.kernels.element_kernels import element_forces, element_slopes
from hapticmech_ros.mechanism.kernels.manifold_kernels import local_rates, move
from hapticmech_ros.mechanism.kernels.metric_kernels import accelerate
from hapticmech_ros.mechanism.kernels.model import (
    MOST_STAGES,
    Data,
    Model,
    StepAccount,
    StepSettings,
    Work,
)
from hapticmech_ros.mechanism.kernels.motion_kernels import (
    add_link_forces,
    add_point_forces,
    closure_bias,
    move_joints,
)
from hapticmech_ros.mechanism.kernels.tree_kernels import bias_force_of
from hapticmech_ros.mechanism.schemes import COUPLED, DIAGONAL, REACHED, TSITOURAS_REACHED
from hapticmech_ros.numerics import Array
from hapticmech_ros.numerics.small_matrices import (
    add_scaled,
    cholesky,
    dot,
    dot_with_row,
    remove,
    solve_lower,
    solve_lower_transposed,
)


@inner
def linearise(model: Model, data: Data, parts: Work) -> int:
    """Fill the matrices of implicit stages at the step's start; return the first bad row, or -1.

    K, C, S = γh C + (γh)² K, and the factor of 1 + P L⁻¹ S L⁻ᵀ P. The factor is computed in place:
    its lower triangle is read before it is written.
    """
    stiffness, damping = model.stiffness_matrix, model.damping_matrix
    nv, seen, step = model.nv, model.slope_factor, parts.settings.step
    element_slopes(model, data, parts.q, parts.v, step, stiffness, damping)
    reach, steepest, rank = DIAGONAL * step, 0.0, int(data.tail.rank)
    for i in range(nv):
        for j in range(nv):
            found = reach * damping[i, j] + reach * reach * stiffness[i, j]
            model.slope[i, j], seen[i, j] = found, found
            steepest = max(steepest, abs(found))
    model.steepest[0] = steepest
    if steepest == 0.0:
        return -1
    for _ in range(2):
        for i in range(nv):
            solve_lower(data.factor, seen[i])
            remove(data.basis, rank, seen[i], model.along)
        for i in range(nv):
            for j in range(i):
                seen[i, j], seen[j, i] = seen[j, i], seen[i, j]
    for i in range(nv):
        seen[i, i] += 1.0
    return cholesky(seen, seen)


@inner
def _answer(model: Model, data: Data, force: Array) -> None:
    """Replace ``force`` (nv,) by x with (D + S) x + Wᵀμ = force and W x = 0."""
    solve_lower(data.factor, force)
    remove(data.basis, int(data.tail.rank), force, model.along)
    solve_lower(model.slope_factor, force)
    solve_lower_transposed(model.slope_factor, force)
    solve_lower_transposed(data.factor, force)


@inner
def aim_implicitly(model: Model, start: Data, parts: Work, stage: int, rates: Array) -> None:
    """Add an implicit stage, and set q, v and θ̇ of the next one, or of the end.

    Args:
        model: the mechanism's.
        start: terms at the step's start.
        parts: see :class:`Work`.
        stage: its number.
        rates: (nv,) v̇.
    """
    period, nv = parts.settings.step, rates.size
    turns, gains, force = model.turns, model.gains, model.pushed
    turn, gain, met, moved = turns[stage], gains[stage], model.met, model.moved
    for c in range(nv):
        met[c], moved[c] = 0.0, 0.0
        for j in range(stage):
            met[c] += COUPLED[stage, j] * turns[j, c]
            moved[c] += COUPLED[stage, j] * gains[j, c]
        turn[c], gain[c] = parts.turn[c] + period * moved[c], rates[c]
        met[c] += DIAGONAL * turn[c]
    if model.steepest[0] > 0.0:
        for c in range(nv):
            force[c] = dot_with_row(model.stiffness_matrix, c, met)
            force[c] += dot_with_row(model.damping_matrix, c, moved)
            force[c] = dot_with_row(model.slope, c, gain) + period * force[c]
        _answer(model, start, force)
        add_scaled(gain, -1.0, force)
    add_scaled(turn, period * DIAGONAL, gain)
    reach(model, parts, turns, gains, REACHED, stage)


def work_size(nq: int, nv: int, points: int) -> int:
    """Return the length of an array of work."""
    fixed = StepSettings.layout.size + 2 * MOST_STAGES + StepAccount.layout.size
    return fixed + 2 * nq + 7 * nv + 6 * points


@inner
def start_step(work: Work) -> None:
    """Go to the step's start, with nothing summed."""
    account = work.account
    put(work.q, work.q0)
    put(work.v, work.v0)
    put(work.turn, work.v0)
    work.turned[:] = 0.0
    work.gained[:] = 0.0
    account.last_residual, account.step_length, account.projection_length = np.inf, np.inf, 0.0


@inner
def find_rates(
    model: Model, data: Data, parts: Work, weight: float, external: Array, result: Array
) -> None:
    """Fill ``result`` (nv + m,) with v̇ and λ at ``parts.q`` and ``parts.v``.

    ``data`` has been filled there. ``weight`` times its powers goes to the account.
    """
    nv, m = model.nv, model.m
    bias, forces, motions = model.bias, model.forces, model.motions
    move_joints(model, data, parts.v, motions)
    passive, dissipative, bias_force = forces[0], forces[1], forces[2]
    bias_force_of(model, data, motions, bias_force)
    if m > 0:
        closure_bias(model, data, parts.v, motions, bias)
        if parts.settings.baumgarte_rate > 0.0:
            _pull(model, data, parts, bias)
    v, held, effort, settings = parts.v, parts.held, model.effort, parts.settings
    element_forces(model, data, parts.q, v, passive, dissipative)
    force, touch, touching = local(nv), local(nv), int(settings.contact_wrenches)
    for c in range(nv):
        result[c], touch[c] = held[c] + effort[c], 0.0
    add_point_forces(model, data, parts.wrenches, result)
    if touching > 0:
        add_link_forces(model, data, external[:touching], touch)
    if external.shape[0] > touching:
        add_link_forces(model, data, external[touching:], result)
    for c in range(nv):
        result[c] += touch[c]
        force[c] = result[c]
    lost = dot(dissipative[:nv], v)
    accelerate(model, data, bias_force, passive, bias, result)
    # By the semi-implicit rule positions move with the rates at the step's end.
    account, step = parts.account, weight * settings.step
    late = settings.semi_implicit * settings.step
    account.energy_lost -= step * lost
    for c in range(nv):
        moved = step * (v[c] + late * result[c])
        account.work_in += moved * force[c]
        account.contact_work += moved * touch[c]


@inner
def _pull(model: Model, data: Data, parts: Work, bias: Array) -> None:
    """Add Baumgarte's pull 2a W v + a² φ to ``bias`` (m,)."""
    pull, axes, closures = parts.settings.baumgarte_rate, data.joint_jacobian, model.closures
    carriers, joints, pairs = model.carriers, model.joints, data.pairs
    residual, v = data.residual, parts.v
    for index in range(closures.shape[0]):
        row_of = closures[index]
        kind, a, b, first = row_of[0], row_of[1], row_of[2], row_of[3]
        for i in range(first, end_of_rows(closures, index, model.m)):
            speed = pair_power(joints, axes, carriers[a], carriers[b], pairs[i], v)
            if kind == COUPLING:
                speed = gear_speed(model, data.poses, a, b, v)
            bias[i] += 2.0 * pull * speed + pull * pull * residual[i]


@inner
def aim(model: Model, work: Work, weight: float, fraction: float, acceleration: Array) -> None:
    """Add an explicit stage to the sums, and set q, v and θ̇ of the next one, or of the end."""
    settings, v, v0, theta = work.settings, work.v, work.v0, work.theta
    turn, turned, gained = work.turn, work.turned, work.gained
    period, late = settings.step, settings.semi_implicit != 0.0
    for c in range(v.size):
        turned[c] += weight * turn[c]
        gained[c] += weight * acceleration[c]
        if fraction > 0.0:
            step = fraction * period
            theta[c] = step * turn[c]
            v[c] = v0[c] + step * acceleration[c]
        else:
            v[c] = v0[c] + period * gained[c]
            theta[c] = period * (v[c] if late else turned[c])
    follow(model, work)


@inner
def reach(model: Model, work: Work, turns: Array, gains: Array, reached: Array, stage: int) -> None:
    """Set q, v and θ̇ of the next stage, or of the end, from those of all stages so far.

    Args:
        model: the mechanism's.
        work: of the step.
        turns: (stages, nv) θ̇ of the stages.
        gains: (stages, nv) v̇.
        reached: (stages, stages) where stages are reached from those before.
        stage: the last one that is known.
    """
    period, last = work.settings.step, stage == reached.shape[0] - 1
    for c in range(work.v.size):
        turned, gained = 0.0, 0.0
        for j in range(stage + 1):
            weight = work.scheme[j, 0] if last else reached[stage + 1, j]
            turned += weight * turns[j, c]
            gained += weight * gains[j, c]
        work.theta[c] = period * turned
        work.v[c] = work.v0[c] + period * gained
    follow(model, work)


@inner
def aim_by_all(model: Model, work: Work, stage: int, acceleration: Array) -> None:
    """Keep an explicit stage, and set the next one, or the end, from all of them."""
    put(model.turns[stage], work.turn)
    put(model.gains[stage], acceleration[: model.nv])
    reach(model, work, model.turns, model.gains, TSITOURAS_REACHED, stage)


@inner
def follow(model: Model, work: Work) -> None:
    """Set q and θ̇ from θ and v."""
    q, q0, v, theta, turn = work.q, work.q0, work.v, work.theta, work.turn
    flat = q.size == v.size
    for c in range(v.size):
        turn[c] = v[c]
        if flat:
            q[c] = q0[c] + theta[c]
    if not flat:
        move(model, q0, theta, q)
        if work.settings.local_rates != 0.0:
            local_rates(model, theta, v, turn)
