# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The mass metric and its part that closures leave free: dense or sparse, by one name.

With D = L Lᵀ, L⁻¹ takes joint forces to the metric and L⁻ᵀ takes it to rates; U spans the columns
of L⁻¹Wᵀ. See :mod:`~hapticmech_ros.mechanism.constraint_space`.
"""

from __future__ import annotations

import numpy as np

from hapticmech_ros.compilation import inner, kernel
from hapticmech_ros.mechanism.kernels.articulated_kernels import (
    force_to_metric,
    sweep_outwards,
)
from hapticmech_ros.mechanism.kernels.band_kernels import (
    clear_pivots,
    solve_rows,
    turn_back,
    turn_in,
)
from hapticmech_ros.mechanism.kernels.model import SPARSE, Data, Model
from hapticmech_ros.numerics import Array
from hapticmech_ros.numerics.small_matrices import (
    add_scaled,
    dot_with_row,
    remove,
    solve_lower,
    solve_lower_transposed,
)


@inner
def to_metric(model: Model, data: Data, vector: Array) -> None:
    """Replace joint forces (nv,) by L⁻¹ of them."""
    if model.path == SPARSE:
        force_to_metric(model, data, vector)
    else:
        solve_lower(data.factor, vector)


@inner
def from_metric(model: Model, data: Data, vector: Array) -> None:
    """Replace ``vector`` (nv,) by joint rates L⁻ᵀ vector."""
    if model.path == SPARSE:
        sweep_outwards(model, data, vector, False)
    else:
        solve_lower_transposed(data.factor, vector)


@kernel("void(Model, Data, float64[::1])")
def lift(model: Model, data: Data, rates: Array) -> None:
    """Replace joint rates by Lᵀ of them.

    Args:
        model: constants of the mechanism.
        data: terms at the configuration.
        rates: (nv,) rates or a change of q, replaced by their mass-metric coordinates.
    """
    if model.path == SPARSE:
        sweep_outwards(model, data, rates, True)
        return
    factor = data.factor
    for i in range(rates.size):
        total = 0.0
        for k in range(i, rates.size):
            total += factor[k, i] * rates[k]
        rates[i] = total


@inner
def free_part(model: Model, data: Data, vector: Array) -> None:
    """Replace ``vector`` (nv,) by its free part, (1 - U Uᵀ) vector."""
    rank = int(data.tail.rank)
    if rank == 0:
        return
    if model.path == SPARSE:
        turned = model.turned
        turn_in(model, data, vector, turned)
        clear_pivots(model, data, turned)
        turn_back(model, data, turned, vector)
    else:
        remove(data.basis, rank, vector, model.along)


@kernel("void(Model, Data, float64[::1], float64[::1], float64[::1], float64[::1])")
def accelerate(
    model: Model, data: Data, bias_force: Array, passive: Array, bias: Array, result: Array
) -> None:
    """Solve Eq. 1: replace joint forces by v̇, followed by λ.

    A sparse factorisation gives no λ: it would not be the smallest one where rows are redundant.

    Args:
        model: constants of the mechanism.
        data: terms at the configuration.
        bias_force: (nv,) h, N m or N.
        passive: (nv,) forces of elements without efforts, N m or N.
        bias: (m,) Ẇv, m/s² or 1/s².
        result: (nv + m,) Σ Jᵀ F and efforts, N m or N, replaced by v̇ and λ; λ is NaN if sparse.
    """
    nv, rank = model.nv, int(data.tail.rank)
    rates, multipliers = result[:nv], result[nv:]
    for c in range(nv):
        rates[c] = rates[c] + passive[c] - bias_force[c]
    to_metric(model, data, rates)
    if model.path == SPARSE:
        multipliers[:] = np.nan
        if rank > 0:
            turned = model.turned
            turn_in(model, data, rates, turned)
            solve_rows(model, data, bias, -1.0, turned)
            turn_back(model, data, turned, rates)
    else:
        multipliers[:] = 0.0
        basis, rows, sigma, surplus = data.basis, data.rows, data.sigma, model.along
        for i in range(rank):
            surplus[i] = dot_with_row(basis, i, rates)
            surplus[i] += dot_with_row(rows, i, bias) / sigma[i]
        for i in range(rank):
            add_scaled(rates, -surplus[i], basis[i])
            add_scaled(multipliers, surplus[i] / sigma[i], rows[i])
    from_metric(model, data, rates)


@kernel("void(Model, Data, float64[::1], float64[::1])")
def correction_of(model: Model, data: Data, residual: Array, change: Array) -> None:
    """Fill ``change`` with D⁻¹Wᵀ(W D⁻¹Wᵀ)⁺ residual.

    Args:
        model: constants of the mechanism.
        data: terms at the configuration.
        residual: (m,) φ, rad or m.
        change: (nv,) to fill, rad or m.
    """
    change[:] = 0.0
    rank = int(data.tail.rank)
    if model.path == SPARSE:
        turned = model.turned
        turned[:] = 0.0
        solve_rows(model, data, residual, 1.0, turned)
        turn_back(model, data, turned, change)
    else:
        basis, rows, sigma = data.basis, data.rows, data.sigma
        for i in range(rank):
            along = dot_with_row(rows, i, residual) / sigma[i]
            add_scaled(change, along, basis[i])
    from_metric(model, data, change)


@kernel("void(Model, Data, float64[::1])")
def close_rates(model: Model, data: Data, rates: Array) -> None:
    """Replace rates v by v - D⁻¹Wᵀ(W D⁻¹Wᵀ)⁺ W v.

    Args:
        model: constants of the mechanism.
        data: terms at the configuration.
        rates: (nv,) rad/s or m/s, replaced by the nearest with W v = 0.
    """
    lift(model, data, rates)
    free_part(model, data, rates)
    from_metric(model, data, rates)
