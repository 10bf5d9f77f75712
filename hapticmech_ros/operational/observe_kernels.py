# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Kernel of all that rendering needs of an operational point: terms, analysis, delay, motion.

Beside it: the number of joint constraints, by a Schmitt trigger with dwell on each s_i; rates of a
mechanism's last states, by their stamps; and the contacts' dynamically consistent wrench at an
operational point.

    F_c = J̄ᵀ Σ J_cᵀ λ,      J̄ = D⁻¹ P J_hᵀ X⁺

is the wrench at the point that accelerates it as the contacts do: X F_c = a_c. Along directions
that the joints constrain (weight w(s_i) of 1) no wrench does, and F_c has no part there.

Parts of kernels: the analysis at an operational point: X, its spectrum, P_c, Π and a_0.

Delay compensation: X_τ and a_τ of an operational point, its X and a_0 for a loop with a delay τ.

The forces of springs, dampers and weight at a state reach the hand after τ; a force takes effect
during that time. So the state is predicted: q' is where the mechanism will be after τ at its rates,
and with the accelerations v̇ of then, rates v_b a time τ_b ago, and r = τ / τ_b,

    v(τ) = v + r² / (1 + 2 r) (v - v_b) + h v̇,      h = τ (1 + r) / (1 + 2 r)
    q(τ) = q' ⊕ k v̇,                                k = τ² / 2

which is the backward differentiation formula of second order for v. With the stiffness K and the
damping C of springs and dampers

    X_τ = J (D + h C + k K)⁻¹ Jᵀ
    a_τ = a_0(q', v) - J (D + h C + k K)⁻¹ ((h C + k K) v̇_0(q', v) + C r² / (1 + 2 r) (v - v_b))

where v̇_0 are the accelerations at zero hand wrench, and closures hold on as they do in X. That is
a step of length τ, implicit in springs and dampers: X_τ F + a_τ is the acceleration by then, also
if F varies meanwhile, with an error of third order in τ, except for changes of Coriolis forces with
v, and of X during τ. Where v_b is not known, as at the start or after a closure has closed, r is 0
and k is τ², and the error is of second order. Both are found in the directions of X alone: with
rows ζ_i = n_iᵀ J D⁻¹ / s_i, closures kept, which are orthonormal in the mass metric, and B = 1 + ζ
(h C + k K) ζᵀ, which is never smaller than 1,

    X_τ = Z B⁻¹ Zᵀ,  a_τ = a_0(q', v) - Z B⁻¹ ζ ((h C + k K) v̇_0(q', v) + ...)

with columns I_ℓ⁻¹ n_i s_i in Z. B leaves out joints that move without the point, which is exact to
first order too; and B being no smaller than 1, no gain is larger than X's.

To second order q' = q ⊕ (τ v - ½ τ² D⁻¹Wᵀ(W D⁻¹Wᵀ)⁺ Ẇv) is on the closures. Next to a singular
position, where the remaining φ turns free rates by more than 1 %, q' is q.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from hapticmech_ros.compilation import inner, kernel, local, local_whole, put, shaped
from hapticmech_ros.compilation.records import Nested, Number, Record, Vector, matrix
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
from hapticmech_ros.mechanism.kernels.model import SPARSE, Data, Model
from hapticmech_ros.mechanism.kernels.motion_kernels import closure_bias, move_joints, move_point
from hapticmech_ros.mechanism.kernels.tree_kernels import bias_force_of
from hapticmech_ros.numerics import Array
from hapticmech_ros.numerics.layout import OperationalModelSample
from hapticmech_ros.numerics.rotation_kernels import quaternion_of
from hapticmech_ros.numerics.small_matrices import (
    add_scaled,
    cholesky,
    dot,
    dot_rows,
    dot_with_row,
    orthogonalise,
    solve_lower,
)


class PointResponse(Record):
    """How an operational point answers forces: X F + a_0; axes of the world, at the point.

    Attributes:
        inverse_inertia: X, 1/kg, 1/(kg m) and 1/(kg m²).
        free_acceleration: a_0, m/s² and rad/s².
    """

    inverse_inertia = matrix(6, 6)
    free_acceleration = Vector(6)


class Observed(OperationalModelSample):
    """The first part of an observation of a point: the model for a loop with delay.

    Attributes:
        now: X and a_0 without delay compensation.
    """

    now = Nested(PointResponse)


MODEL_SIZE, _OBSERVED = OperationalModelSample.layout.size, Observed.layout.size


class Details(NamedTuple):
    """The second part of an observation; t rows of the task space.

    Attributes:
        weights: (t,) w(s_i).
        directions: (2, t, t) columns n_i and I_ℓ⁻¹ n_i.
        jacobian: (6, nv) J_h.
        motion: (12,) J_h v and J̇_h v, m/s and m/s², rad/s and rad/s².
    """

    weights: Array
    directions: Array
    jacobian: Array
    motion: Array


def observation_size(t: int, nv: int) -> int:
    """Return the length of an observation with t rows of the task space."""
    return _OBSERVED + t * (1 + 2 * t) + 6 * nv + 12


def details_in(observation: Array, t: int, nv: int) -> Details:
    """Return the parts of an observation behind :class:`Observed`, as views.

    Args:
        observation: (n,) see :func:`observation_size`.
        t: rows of the task space.
        nv: number of rates.
    """
    rest = observation[_OBSERVED:]
    at = t * (1 + 2 * t)
    return Details(
        rest[:t],
        shaped(rest[t:], (2, t, t)),
        shaped(rest[at:], (6, nv)),
        rest[at + 6 * nv : at + 6 * nv + 12],
    )


_details_of = inner(details_in)
# Off the closures by φ, at a relative singular value σ, free rates turn by φ/σ²: by no more than
# this share of the length, or the prediction is not used.
TRUSTED = 0.01


@inner
def _least(model: Model, data: Data) -> float:
    """Return σ_r / σ_1; an estimate from above, where the factorisation is sparse."""
    rank = int(data.tail.rank)
    if rank == 0:
        return 1.0
    if model.path == SPARSE:
        return float(data.tail.least_sigma)
    return float(data.sigma[rank - 1] / data.sigma[0])


@inner
def _trusted(model: Model, data: Data, before: Data, length: float) -> bool:
    """Return whether closures at a predicted configuration are as well resolved as before."""
    if data.tail.rank != before.tail.rank:
        return False
    return bool(data.tail.largest_residual <= TRUSTED * _least(model, data) ** 2 * length)


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

    The model's workspace, with motions and forces, is of that configuration afterwards.

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
    later = Data(model.numbers, ahead)
    if factor(model, place, later) < 0 or not _trusted(model, later, data, length):
        return
    motions, bias_force, passive = model.motions, model.forces[0], model.forces[1]
    move_joints(model, later, v, motions)
    bias_force_of(model, later, motions, bias_force)
    closure_bias(model, later, v, motions, model.bias)
    element_forces(model, later, place, v, passive, model.forces[2])
    add_scaled(passive[:nv], 1.0, model.effort)
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
                add_scaled(rates[i], wrenches[k, i] / s[i], along[k])


@inner
def compensate(
    model: Model,
    data: Data,
    q: Array,
    v: Array,
    bias_force: Array,
    passive: Array,
    bias: Array,
    index: int,
    rows: Array,
    details: Details,
    length: float,
    compensated_delay: float,
    before: Array,
    ahead: Array,
    found: Observed,
) -> None:
    """Turn X into X_τ, and a_0 into a_τ, of an operational point that is analysed.

    Args:
        model: the mechanism's.
        data: terms at the configuration.
        q: (nq,) configuration.
        v: (nv,) rates.
        bias_force: (nv,) h.
        passive: (nv,) forces of springs, dampers, friction and stops, and efforts.
        bias: (m,) Ẇv.
        index: number of the operational point.
        rows: (t,) rows of a six-vector that the task space has.
        details: as ``analyse_motion`` filled them.
        length: of the mechanism, m.
        compensated_delay: τ, s.
        before: (1 + nv,) rates that were, and before them how long ago, s; 0 if unknown.
        ahead: as long as the terms, to work in.
        found: the analysis; X and a_0 in it become X_τ and a_τ.
    """
    t, nv, s = rows.size, model.nv, found.s
    directions, free = details.directions, found.free_acceleration
    rates = shaped(local(t * nv), (t, nv))
    _unit_rates(model, data, details.jacobian, rows, s, directions[0], rates)
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
    predict(model, data, q, v, bias, index, length, compensated_delay, ahead, own, free)
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
    inverse_inertia = found.inverse_inertia
    inverse_inertia[:] = 0.0
    for i in range(t):
        for j in range(i + 1):
            product = dot_rows(shown, i, j)
            inverse_inertia[rows[i], rows[j]] = product
            inverse_inertia[rows[j], rows[i]] = product
        free[rows[i]] -= dot(shown[i], met)


class Metric(NamedTuple):
    """Constants of the analysis of a point; t rows of the task.

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
                add_scaled(factors[which, i], turn[i, k], metric.factors[which, k])


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
    rotation: Array,
    metric: Metric,
    rows: Array,
    found: Observed,
    details: Details,
) -> bool:
    """Analyse an operational point.

    Args:
        model: the mechanism's.
        data: terms at the configuration.
        bias_force: (nv,) h.
        passive: (nv,) forces of springs, dampers, friction and stops, and efforts.
        bias: (m,) Ẇv.
        rotation: (3, 3) of the point.
        metric: constants.
        rows: (t,) rows of a six-vector that the task space has.
        found: s, X, P_c, Π and a_0 to fill; zero in rows that the task space does not have.
        details: with the point's motion; weights and columns n_i and I_ℓ⁻¹ n_i to fill.

    Returns:
        Whether the SVD of S converged.
    """
    nv, m, t = model.nv, model.m, rows.size
    jacobian, drift = details.jacobian, details.motion[6:]
    spectrum, inverse_inertia = found.s, found.inverse_inertia
    projector, balance = found.constraint_projector, found.wrench_projector
    spectrum[:] = 0.0
    inverse_inertia[:] = 0.0
    projector[:] = 0.0
    balance[:] = 0.0
    free = local(nv + m)
    free[:] = 0.0
    accelerate(model, data, bias_force, passive, bias, free)
    for i in range(6):
        found.free_acceleration[i] = dot_with_row(jacobian, i, free) + drift[i]
    # Rows are the columns of S.
    root = shaped(local(t * nv), (t, nv))
    for i in range(t):
        put(root[i], jacobian[rows[i]])
        to_metric(model, data, root[i])
        free_part(model, data, root[i])
    for i in range(t):
        for j in range(i + 1):
            product = dot_rows(root, i, j)
            inverse_inertia[rows[i], rows[j]] = product
            inverse_inertia[rows[j], rows[i]] = product
    factors = shaped(local(72), (2, t, t))
    _in_world(metric, rotation, rows, factors)
    measured, turn = shaped(local(t * nv), (t, nv)), shaped(local(36), (t, t))
    measured[:] = 0.0
    for j in range(t):
        for i in range(t):
            add_scaled(measured[j], factors[0, i, j], root[i])
    lengths = local(6)
    if not _spectrum(measured, turn, lengths):
        return False
    weights, directions = details.weights, details.directions
    for i in range(t):
        s = lengths[i] if i < nv else 0.0
        x = min(max((metric.s_off - s) / (metric.s_off - metric.s_on), 0.0), 1.0)
        spectrum[i] = s
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
            projector[rows[i], rows[j]] = projected / metric.mass
            balance[rows[i], rows[j]] = balanced
    return True


# Of the analysis alone; a negative code of the closures is one of ``factor_kernels.factor``.
NO_SPECTRUM = 1


@kernel(
    "int64(int64[::1], float64[::1], float64[::1], int64, float64[::1], float64[::1], int64,"
    " float64[::1], int64[::1], float64, float64, float64[::1], float64[::1], float64[::1])",
    linked=True,
)
def observe_point(
    numbers: Array,
    values: Array,
    packed: Array,
    known: int,
    q: Array,
    v: Array,
    index: int,
    constants: Array,
    rows: Array,
    length: float,
    delay: float,
    before: Array,
    ahead: Array,
    observation: Array,
) -> int:
    """Evaluate Eq. 1 at a state and analyse an operational point there.

    Args:
        numbers: (integers,) constants of the mechanism, whole ones.
        values: (numbers,) the others; see ``model.pack``.
        packed: (size,) packed terms at the configuration; filled first, unless they are known.
        known: whether they are.
        q: (nq,) configuration.
        v: (nv,) rates.
        index: number of the operational point.
        constants: (numbers,) of the analysis; see ``metric_of``.
        rows: (t,) rows of a six-vector that the task space has.
        length: of the mechanism, m.
        delay: τ of the loop, s; 0 for none.
        before: (1 + nv,) rates that were, and before them how long ago, s; 0 if unknown.
        ahead: (size,) as long as ``packed``, to work in.
        observation: (numbers,) to fill: an :class:`Observed`, and :class:`Details`. F_c is zero.

    Returns:
        0; NO_SPECTRUM where the SVD of S does not converge; or a negative code.
    """
    model, metric = Model(numbers, values), metric_of(constants, rows.size)
    data = Data(model.numbers, packed)
    nv, t = model.nv, rows.size
    if known == 0:
        code = factor(model, q, data)
        if code < 0:
            return code
    motions, bias, forces = model.motions, model.bias, model.forces
    bias_force, passive, dissipative = forces[0], forces[1], forces[2]
    move_joints(model, data, v, motions)
    bias_force_of(model, data, motions, bias_force)
    closure_bias(model, data, v, motions, bias)
    element_forces(model, data, q, v, passive, dissipative)
    add_scaled(passive[:nv], 1.0, model.effort)
    found, details = Observed(observation), _details_of(observation, t, nv)
    move_point(model, data, motions, index, details.jacobian, details.motion)
    pose = data.poses[model.points[index]]
    rotation = shaped(pose[:9], (3, 3)).T
    converged = analyse_motion(
        model,
        data,
        bias_force,
        passive,
        bias,
        rotation,
        metric,
        rows,
        found,
        details,
    )
    if not converged:
        return NO_SPECTRUM
    put(found.now.inverse_inertia, found.inverse_inertia)
    put(found.now.free_acceleration, found.free_acceleration)
    put(found.position, pose[9:])
    quaternion_of(rotation, found.quaternion)
    put(found.twist, details.motion[:6])
    found.contact[:] = 0.0
    if delay > 0.0:
        compensate(
            model,
            data,
            q,
            v,
            bias_force,
            passive,
            bias,
            index,
            rows,
            details,
            length,
            delay,
            before,
            ahead,
            found,
        )
    return 0


class ConstraintTrigger(Record):
    """A Schmitt trigger with dwell for each direction, s descending.

    Attributes:
        s_on: a direction turns rigid once s has stayed at or below it.
        s_off: it turns free once s has stayed at or above it.
        dwell: for so long, s.
        begun: 1 once s has been seen.
        rigid: 1 for each direction that is reported as rigid.
        since: time since when s disagrees with that, s; NaN if it does not.
    """

    s_on = Number()
    s_off = Number()
    dwell = Number()
    begun = Number()
    rigid = Vector(6)
    since = Vector(6)


# Absorbs the rounding of times that are sums of periods, s.
ROUNDING = 5e-10


@kernel("int64(ConstraintTrigger, float64[::1], float64)")
def count_rigid(trigger: ConstraintTrigger, s: Array, time: float) -> int:
    """Return how many directions are reported as rigid, once s was seen at ``time``.

    Args:
        trigger: changed.
        s: (t,) singular values, descending.
        time: s.
    """
    count, rigid, since = 0, trigger.rigid, trigger.since
    for i in range(s.size):
        was_rigid = rigid[i] != 0.0
        if trigger.begun == 0.0:
            was_rigid = bool(s[i] <= trigger.s_on)
            since[i] = np.nan
        disagrees = s[i] >= trigger.s_off if was_rigid else s[i] <= trigger.s_on
        if not disagrees:
            since[i] = np.nan
        elif np.isnan(since[i]):
            since[i] = time
        if disagrees and time - since[i] >= trigger.dwell - ROUNDING:
            was_rigid = not was_rigid
            since[i] = np.nan
        rigid[i] = 1.0 if was_rigid else 0.0
        count += int(was_rigid)
    trigger.begun = 1.0
    return count


# Of the numbers that go with the states: how many states there are, the row of the newest one, how
# long before a state the rates are wanted, ns, and by how much that may be missed to either side.
COUNT, NEWEST, WANTED, MISSING, FARTHEST = range(5)
PAST_SIZE = 5


@inner
def rates_before(past: Array, stamps: Array, rates: Array, stamp: int, before: Array) -> None:
    """Fill (1 + nv,) how long before a time, s, and the rates that were; zeros if unknown.

    Args:
        past: (5,) whole numbers, see above.
        stamps: (states,) ns.
        rates: (states, nv) rad/s or m/s.
        stamp: the time, ns.
        before: (1 + nv,) to fill.
    """
    before[:] = 0.0
    for back in range(past[COUNT]):
        row = (past[NEWEST] - back) % stamps.size
        age = stamp - stamps[row]
        if age > past[FARTHEST]:
            return
        if age >= past[WANTED] - past[MISSING]:
            before[0] = age / 1e9
            put(before[1:], rates[row])
            return


@inner
def remember_state(past: Array, stamps: Array, rates: Array, stamp: int, v: Array) -> None:
    """Remember the rates of a state.

    Args:
        past: (5,) whole numbers, changed.
        stamps: (states,) ns, changed.
        rates: (states, nv) rad/s or m/s, changed.
        stamp: of the state, ns; not before that of the one before, or those are forgotten.
        v: (nv,) its rates.
    """
    if past[COUNT] > 0 and stamp < stamps[past[NEWEST]]:
        past[COUNT] = 0
    if past[WANTED] == 0:
        return
    past[NEWEST] = (past[NEWEST] + 1) % stamps.size
    past[COUNT] = min(past[COUNT] + 1, stamps.size)
    stamps[past[NEWEST]] = stamp
    put(rates[past[NEWEST]], v)


@kernel(
    "void(Model, Data, float64[::1], int64[::1], float64[::1], float64[::1])",
    linked=True,
)
def consistent_wrench(
    model: Model,
    data: Data,
    observation: Array,
    rows: Array,
    joint_force: Array,
    wrench: Array,
) -> None:
    """Fill F_c = Σ (1 - w_i) n_i (n_iᵀ a_c) / μ_i, as X n_i = μ_i I_ℓ⁻¹ n_i; T18 of derivations.md.

    Args:
        model: constants of the mechanism.
        data: terms at the configuration.
        observation: (numbers,) of the point there; see :func:`observe_point`.
        rows: (t,) rows of a six-vector that the task space has.
        joint_force: (nv,) Σ J_cᵀ λ, N m or N.
        wrench: (6,) F_c to fill, N and N m, world axes at the point.
    """
    nv, t, acceleration = model.nv, rows.size, local(6)
    rates = local(nv)
    put(rates, joint_force)
    to_metric(model, data, rates)
    free_part(model, data, rates)
    from_metric(model, data, rates)
    details, s = _details_of(observation, t, nv), Observed(observation).s
    weights, directions = details.weights, details.directions[0]
    for r in range(6):
        acceleration[r], wrench[r] = dot(details.jacobian[r], rates), 0.0
    for i in range(t):
        if weights[i] < 1.0:
            along = 0.0
            for r in range(t):
                along += directions[r, i] * acceleration[rows[r]]
            share = (1.0 - weights[i]) * along / (s[i] * s[i])
            for r in range(t):
                wrench[rows[r]] += directions[r, i] * share
