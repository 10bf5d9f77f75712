# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Parts of kernels: the analysis at an operational point: X, its spectrum, P_c, Π and a_0.

Delay compensation: X_τ and a_τ of an operational point, its X and a_0 for a loop with a delay τ.

What springs, dampers and weight do at a state reaches the hand after τ; a force takes effect during
that time. So the state is predicted: q' is where the mechanism will be after τ at its rates, and
with the accelerations v̇ of then, rates v_b a time τ_b ago, and r = τ / τ_b,

    v(τ) = v + r² / (1 + 2 r) (v - v_b) + h v̇,      h = τ (1 + r) / (1 + 2 r)
    q(τ) = q' ⊕ k v̇,                                k = τ² / 2

which is the backward differentiation formula of second order for v. With the stiffness K and the
damping C of springs and dampers

    X_τ = J (D + h C + k K)⁻¹ Jᵀ
    a_τ = a_0(q', v) - J (D + h C + k K)⁻¹ ((h C + k K) v̇_0(q', v) + C r² / (1 + 2 r) (v - v_b))

where v̇_0 are the accelerations at zero hand wrench, and closures hold on as they do in X. That is
a step of length τ, implicit in springs and dampers: X_τ F + a_τ is the acceleration by then, also
if F varies meanwhile, with an error of third order in τ, but for what Coriolis forces change as v
does, and for what X does on the way. Where v_b is not known, as at the start or after a closure has
closed, r is 0 and k is τ², and the error is of second order. Both are found in the directions of X
alone: with rows ζ_i = n_iᵀ J D⁻¹ / s_i, closures kept, which are orthonormal in the mass metric,
and B = 1 + ζ (h C + k K) ζᵀ, which is never smaller than 1,

    X_τ = Z B⁻¹ Zᵀ,  a_τ = a_0(q', v) - Z B⁻¹ ζ ((h C + k K) v̇_0(q', v) + ...)

with columns I_ℓ⁻¹ n_i s_i in Z. What joints that move without the point add to it is left out of
B, which is exact to first order too; and B being no smaller than 1, no gain is larger than X's.

To second order q' = q ⊕ (τ v - ½ τ² D⁻¹Wᵀ(W D⁻¹Wᵀ)⁺ Ẇv) is on the closures. Next to a singular
position, where what is left of φ there turns free rates by more than 1 %, q' is q.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from hapticmech_ros.arrays import Array
from hapticmech_ros.compilation import inner, local, local_whole, put, shaped
from hapticmech_ros.layout import OPERATIONAL_MODEL
from hapticmech_ros.mechanism.kernels.element_kernels import element_forces, element_resistance
from hapticmech_ros.mechanism.kernels.factor_kernels import factor
from hapticmech_ros.mechanism.kernels.manifold_kernels import move
from hapticmech_ros.mechanism.kernels.many_rows import triangularise
from hapticmech_ros.mechanism.kernels.metric_kernels import (
    accelerate,
    correction_of,
    free_part,
    from_metric,
    to_metric,
)
from hapticmech_ros.mechanism.kernels.model import ERROR, LEAST, RANK, SPARSE, Data, Model, unpack
from hapticmech_ros.mechanism.kernels.motion_kernels import closure_bias, move_joints, move_point
from hapticmech_ros.mechanism.kernels.small_matrices import (
    cholesky,
    dot,
    dot_rows,
    dot_with_row,
    orthogonalise,
    solve_lower,
)
from hapticmech_ros.mechanism.kernels.tree_kernels import bias_force_of

# Off the closures by φ, at a relative singular value σ, free rates turn by φ/σ²: by no more than
# this share of the length, or the prediction is not used.
TRUSTED = 0.01


@inner
def _least(model: Model, data: Data) -> float:
    """Return σ_r / σ_1; an estimate from above, where the factorisation is sparse."""
    rank = int(data.tail[RANK])
    if rank == 0:
        return 1.0
    if model.path == SPARSE:
        return float(data.tail[LEAST])
    return float(data.sigma[rank - 1] / data.sigma[0])


@inner
def _trusted(model: Model, data: Data, before: Data, length: float) -> bool:
    """Return whether closures at a predicted configuration are as well resolved as before."""
    if data.tail[RANK] != before.tail[RANK]:
        return False
    return bool(data.tail[ERROR] <= TRUSTED * _least(model, data) ** 2 * length)


@inner
def predict(
    model: Model,
    data: Data,
    q: Array,
    v: Array,
    bias: Array,
    index: int,
    length: float,
    compensated_delay: float,
    ahead: Array,
    own: Array,
    free: Array,
) -> None:
    """Replace v̇_0 and a_0 by those at the configuration after τ, where it can be trusted.

    The model's workspace, what moves and forces there, is of that configuration afterwards.

    Args:
        model: the mechanism's.
        data: terms at the configuration.
        q: (nq,) configuration.
        v: (nv,) rates.
        bias: (m,) Ẇv.
        index: number of the operational point.
        length: of the mechanism, m.
        compensated_delay: τ, s.
        ahead: to fill with terms at the configuration after τ.
        own: (nv + m,) v̇_0 and λ.
        free: (6,) a_0.
    """
    nv = model.nv
    change, place = local(nv), local(q.size)
    correction_of(model, data, bias, change)
    for c in range(nv):
        change[c] = (
            compensated_delay * v[c] - 0.5 * compensated_delay * compensated_delay * change[c]
        )
    move(model, q, change, place)
    later = unpack(ahead, model)
    if factor(model, place, later) < 0 or not _trusted(model, later, data, length):
        return
    motions, bias_force, passive = model.motions, model.forces[0], model.forces[1]
    move_joints(model, later, v, motions)
    bias_force_of(model, later, motions, bias_force)
    closure_bias(model, later, v, motions, model.bias)
    element_forces(model, later, place, v, passive, model.forces[2])
    for c in range(nv):
        passive[c] += model.effort[c]
    jacobian, motion = shaped(local(6 * nv), (6, nv)), local(12)
    move_point(model, later, motions, index, jacobian, motion)
    own[:] = 0.0
    accelerate(model, later, bias_force, passive, model.bias, own)
    for i in range(6):
        free[i] = dot_with_row(jacobian, i, own[:nv]) + motion[6 + i]


# As in :mod:`~hapticmech_ros.operational.results`, which kernels do not see.
LEAST_S = 1e-10


@inner
def _unit_rates(
    model: Model,
    data: Data,
    jacobian: Array,
    rows: Array,
    s: Array,
    wrenches: Array,
    rates: Array,
) -> None:
    """Fill ``rates`` with ζ (t, nv); zero where X has nothing."""
    t, nv = rows.size, model.nv
    along = shaped(local(t * nv), (t, nv))
    rates[:] = 0.0
    for i in range(t):
        put(along[i], jacobian[rows[i]])
        to_metric(model, data, along[i])
        free_part(model, data, along[i])
        from_metric(model, data, along[i])
    for i in range(t):
        if s[i] > LEAST_S:
            for k in range(t):
                share = wrenches[k, i] / s[i]
                for c in range(nv):
                    rates[i, c] += share * along[k, c]


@inner
def compensate(
    model: Model,
    data: Data,
    q: Array,
    v: Array,
    bias_force: Array,
    passive: Array,
    bias: Array,
    jacobian: Array,
    index: int,
    rows: Array,
    s: Array,
    details: Array,
    length: float,
    compensated_delay: float,
    before: Array,
    ahead: Array,
    compensated: Array,
) -> None:
    """Fill X_τ, and turn a_0 into a_τ, of an operational point that is analysed.

    Args:
        model: the mechanism's.
        data: terms at the configuration.
        q: (nq,) configuration.
        v: (nv,) rates.
        bias_force: (nv,) h.
        passive: (nv,) forces of springs, dampers, friction and stops, and efforts.
        bias: (m,) Ẇv.
        jacobian: (6, nv) J_h.
        index: number of the operational point.
        rows: (t,) rows of a six-vector that the task space has.
        s: (t,) of the analysis.
        details: (t + 2 t²,) as ``analyse_motion`` filled them.
        length: of the mechanism, m.
        compensated_delay: τ, s.
        before: (1 + nv,) rates that were, and before them how long ago, s; 0 if unknown.
        ahead: as long as the terms, to work in.
        compensated: (42,) X_τ (6, 6) to fill, and a_0 (6,), which becomes a_τ.
    """
    t, nv = rows.size, model.nv
    directions = shaped(details[t:], (2, t, t))
    rates = shaped(local(t * nv), (t, nv))
    _unit_rates(model, data, jacobian, rows, s, directions[0], rates)
    # Of v̇ by then: in the rates, in the configuration; and of how much the rates have changed.
    in_rates, in_place, carried = compensated_delay, compensated_delay * compensated_delay, 0.0
    if before[0] > 0.0:
        ratio = compensated_delay / before[0]
        in_rates *= (1.0 + ratio) / (1.0 + 2.0 * ratio)
        in_place *= 0.5
        carried = ratio * ratio / (1.0 + 2.0 * ratio)
    force, resisted, shown = local(nv), shaped(local(36), (t, t)), shaped(local(36), (t, t))
    for j in range(t):
        element_resistance(model, data, q, v, rates[j], in_place, in_rates, force)
        for i in range(t):
            resisted[i, j] = dot(rates[i], force)
            # Rows are the columns of Zᵀ, each of which is solved with L.
            shown[j, i] = directions[1, j, i] * s[i] if s[i] > LEAST_S else 0.0
        resisted[j, j] += 1.0
    own, met = local(nv + model.m), local(6)[:t]
    own[:] = 0.0
    accelerate(model, data, bias_force, passive, bias, own)
    # From here on the model's workspace is of another configuration.
    predict(model, data, q, v, bias, index, length, compensated_delay, ahead, own, compensated[36:])
    element_resistance(model, data, q, v, own[:nv], in_place, in_rates, force)
    for i in range(t):
        met[i] = dot(rates[i], force)
    if carried > 0.0:
        for c in range(nv):
            own[c] = carried * (v[c] - before[1 + c])
        element_resistance(model, data, q, v, own[:nv], 0.0, 1.0, force)
        for i in range(t):
            met[i] += dot(rates[i], force)
    cholesky(resisted, resisted)
    for j in range(t):
        solve_lower(resisted, shown[j])
    solve_lower(resisted, met)
    compensated[:36] = 0.0
    inverse_inertia = shaped(compensated[:36], (6, 6))
    for i in range(t):
        for j in range(i + 1):
            product = dot_rows(shown, i, j)
            inverse_inertia[rows[i], rows[j]] = product
            inverse_inertia[rows[j], rows[i]] = product
        compensated[36 + rows[i]] -= dot(shown[i], met)


# Where the analysis of an operational model has X, P_c and Π, and a_0; and its length.
SQUARES, FREE, ANALYSIS_SIZE = OPERATIONAL_MODEL.starts(
    "inverse_inertia", "free_acceleration", "position"
)


class Metric(NamedTuple):
    """What is constant in the analysis of a point; t rows of the task.

    Attributes:
        mass: reference mass of the metric, kg.
        s_on: rigid up to here.
        s_off: free from here.
        point_to_link: (3, 3) maps components in the link's axes to those in the point's.
        factors: (2, t, t) G and G⁻ᵀ in the axes of the link.
    """

    mass: float
    s_on: float
    s_off: float
    point_to_link: Array
    factors: Array


@inner
def metric_of(constants: Array, t: int) -> Metric:
    """Return the parts, in their order, of an array (12 + 2 t²,)."""
    return Metric(
        constants[0],
        constants[1],
        constants[2],
        shaped(constants[3:12], (3, 3)),
        shaped(constants[12:], (2, t, t)),
    )


@inner
def _in_world(metric: Metric, rotation: Array, rows: Array, factors: Array) -> None:
    """Fill ``factors`` (2, t, t) with G and G⁻ᵀ in world axes."""
    t = rows.size
    link = shaped(local(9), (3, 3))
    link[:] = 0.0
    for i in range(3):
        for j in range(3):
            for k in range(3):
                link[i, j] += rotation[i, k] * metric.point_to_link[k, j]
    turn = shaped(local(36), (t, t))
    turn[:] = 0.0
    for i in range(t):
        for j in range(t):
            # Forces turn into forces, and torques into torques.
            if (rows[i] < 3) == (rows[j] < 3):
                turn[i, j] = link[rows[i] % 3, rows[j] % 3]
    factors[:] = 0.0
    for which in range(2):
        for i in range(t):
            for k in range(t):
                for j in range(t):
                    factors[which, i, j] += turn[i, k] * metric.factors[which, k, j]


@inner
def _spectrum(measured: Array, turn: Array, lengths: Array) -> bool:
    """Make rows of the task space orthogonal: of many rates, those of their triangular factor.

    Args:
        measured: (t, nv) the rows; used up.
        turn: (t, t) to fill with Vᵀ.
        lengths: (6,) to fill with their singular values s.

    Returns:
        Whether the SVD converged.
    """
    t, nv = measured.shape
    if nv <= t + 2:
        converged = orthogonalise(measured, turn)
        for i in range(t):
            lengths[i] = np.sqrt(dot_rows(measured, i, i))
        return converged
    columns, reflectors = shaped(local(nv * t), (nv, t)), shaped(local(nv * t), (t, nv))
    factor, sums, order = shaped(local(36), (t, t)), shaped(local(12), (2, t)), local_whole(t)
    for c in range(nv):
        for i in range(t):
            columns[c, i] = measured[i, c]
            if not np.isfinite(measured[i, c]):
                return False
    rank = triangularise(columns, t, 0.0, order, reflectors, sums)
    for i in range(t):
        for k in range(t):
            factor[order[i], k] = columns[k, i] if k <= i and k < rank else 0.0
    converged = orthogonalise(factor, turn)
    for i in range(t):
        lengths[i] = np.sqrt(dot_rows(factor, i, i))
    return converged


@inner
def analyse_motion(
    model: Model,
    data: Data,
    bias_force: Array,
    passive: Array,
    bias: Array,
    jacobian: Array,
    drift: Array,
    rotation: Array,
    metric: Metric,
    rows: Array,
    analysis: Array,
    details: Array,
) -> bool:
    """Analyse an operational point.

    Args:
        model: the mechanism's.
        data: terms at the configuration.
        bias_force: (nv,) h.
        passive: (nv,) forces of springs, dampers, friction and stops, and efforts.
        bias: (m,) Ẇv.
        jacobian: (6, nv) J_h.
        drift: (6,) J̇_h v.
        rotation: (3, 3) of the point.
        metric: constants.
        rows: (t,) rows of a six-vector that the task space has.
        analysis: (120,) to fill: an operational model up to a_0; zero in rows that the task space
            does not have.
        details: (t + 2 t²,) to fill with the weights and the columns n_i and I_ℓ⁻¹ n_i.

    Returns:
        Whether the SVD of S converged.
    """
    nv, m, t = model.nv, model.m, rows.size
    analysis[:] = 0.0
    squares = shaped(analysis[SQUARES:], (3, 6, 6))
    free = local(nv + m)
    free[:] = 0.0
    accelerate(model, data, bias_force, passive, bias, free)
    for i in range(6):
        analysis[FREE + i] = dot_with_row(jacobian, i, free) + drift[i]
    # Rows are the columns of S.
    root = shaped(local(t * nv), (t, nv))
    for i in range(t):
        put(root[i], jacobian[rows[i]])
        to_metric(model, data, root[i])
        free_part(model, data, root[i])
    for i in range(t):
        for j in range(i + 1):
            product = dot_rows(root, i, j)
            squares[0, rows[i], rows[j]] = product
            squares[0, rows[j], rows[i]] = product
    factors = shaped(local(72), (2, t, t))
    _in_world(metric, rotation, rows, factors)
    measured, turn = shaped(local(t * nv), (t, nv)), shaped(local(36), (t, t))
    measured[:] = 0.0
    for j in range(t):
        for i in range(t):
            for c in range(nv):
                measured[j, c] += factors[0, i, j] * root[i, c]
    lengths = local(6)
    if not _spectrum(measured, turn, lengths):
        return False
    weights, directions = details[:t], shaped(details[t:], (2, t, t))
    for i in range(t):
        s = lengths[i] if i < nv else 0.0
        x = min(max((metric.s_off - s) / (metric.s_off - metric.s_on), 0.0), 1.0)
        analysis[i] = s
        weights[i] = x * x * x * (10.0 - 15.0 * x + 6.0 * x * x)
        for which in range(2):
            for j in range(t):
                directions[which, j, i] = dot(factors[which, j], turn[i])
    for i in range(t):
        for j in range(t):
            projected, balanced = 0.0, 0.0
            for k in range(t):
                weighted = directions[0, i, k] * weights[k]
                projected += weighted * directions[0, j, k]
                balanced += weighted * directions[1, j, k]
            squares[1, rows[i], rows[j]] = projected / metric.mass
            squares[2, rows[i], rows[j]] = balanced
    return True
