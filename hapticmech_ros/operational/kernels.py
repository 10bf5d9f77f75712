# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Parts of kernels: the analysis at an operational point: X, its spectrum, P_c, Π and a_0."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from hapticmech_ros.arrays import Array
from hapticmech_ros.compilation import inner, local, local_whole, put, shaped
from hapticmech_ros.layout import OPERATIONAL_MODEL
from hapticmech_ros.mechanism.kernels.data import Data
from hapticmech_ros.mechanism.kernels.many_rows import triangularise
from hapticmech_ros.mechanism.kernels.metric_kernels import accelerate, free_part, to_metric
from hapticmech_ros.mechanism.kernels.model import Model
from hapticmech_ros.mechanism.kernels.small_matrices import (
    dot,
    dot_rows,
    dot_with_row,
    orthogonalise,
)

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
