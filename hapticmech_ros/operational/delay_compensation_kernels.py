# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Parts of kernels: X_τ and a_τ; see :mod:`.delay_compensation`."""

from __future__ import annotations

from hapticmech_ros.arrays import Array
from hapticmech_ros.compilation import inner, local, put, shaped
from hapticmech_ros.mechanism.kernels.data import Data
from hapticmech_ros.mechanism.kernels.element_kernels import element_resistance
from hapticmech_ros.mechanism.kernels.metric_kernels import (
    accelerate,
    free_part,
    from_metric,
    to_metric,
)
from hapticmech_ros.mechanism.kernels.model import Model
from hapticmech_ros.mechanism.kernels.small_matrices import (
    cholesky,
    dot,
    dot_rows,
    solve_lower,
)
from hapticmech_ros.operational.prediction_kernels import predict

# As in :mod:`~hapticmech_ros.operational.spectrum`, which kernels do not see.
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
