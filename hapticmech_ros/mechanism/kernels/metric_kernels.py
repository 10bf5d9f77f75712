"""The mass metric and what closures leave of it: dense or sparse, by one name.

With D = L Lᵀ, L⁻¹ takes joint forces to the metric and L⁻ᵀ takes it to rates; U spans the columns
of L⁻¹Wᵀ. See :mod:`~hapticmech_ros.mechanism.constraint_space`.
"""

from __future__ import annotations

import numpy as np

from hapticmech_ros.arrays import Array
from hapticmech_ros.compilation import inner
from hapticmech_ros.mechanism.kernels.articulated_kernels import (
    force_to_metric,
    rates_from_metric,
    rates_to_metric,
)
from hapticmech_ros.mechanism.kernels.band_kernels import (
    clear_pivots,
    solve_rows,
    turn_back,
    turn_in,
)
from hapticmech_ros.mechanism.kernels.packed import Packed
from hapticmech_ros.mechanism.kernels.small_matrices import (
    dot_with_row,
    remove,
    solve_lower,
    solve_lower_transposed,
)
from hapticmech_ros.mechanism.kernels.tables import SPARSE, Tables


@inner
def to_metric(tables: Tables, space: Packed, vector: Array) -> None:
    """Replace joint forces (nv,) by L⁻¹ of them."""
    if tables.path == SPARSE:
        force_to_metric(tables, space, vector)
    else:
        solve_lower(space.factor, vector)


@inner
def from_metric(tables: Tables, space: Packed, vector: Array) -> None:
    """Replace ``vector`` (nv,) by joint rates L⁻ᵀ vector."""
    if tables.path == SPARSE:
        rates_from_metric(tables, space, vector)
    else:
        solve_lower_transposed(space.factor, vector)


@inner
def lift(tables: Tables, space: Packed, rates: Array) -> None:
    """Replace joint rates (nv,) by Lᵀ of them."""
    if tables.path == SPARSE:
        rates_to_metric(tables, space, rates)
        return
    factor = space.factor
    for i in range(rates.size):
        total = 0.0
        for k in range(i, rates.size):
            total += factor[k, i] * rates[k]
        rates[i] = total


@inner
def free_part(tables: Tables, space: Packed, vector: Array) -> None:
    """Replace ``vector`` (nv,) by what the closures leave free of it, (1 - U Uᵀ) vector."""
    rank = int(space.tail[1])
    if rank == 0:
        return
    if tables.path == SPARSE:
        turned = tables.turned
        turn_in(tables, space, vector, turned)
        clear_pivots(tables, space, turned)
        turn_back(tables, space, turned, vector)
    else:
        remove(space.basis, rank, vector, tables.along)


@inner
def accelerate(
    tables: Tables, space: Packed, bias_force: Array, passive: Array, bias: Array, result: Array
) -> None:
    """Replace joint forces in ``result`` (nv + m,) by v̇, followed by λ.

    A sparse factorisation gives no λ: it would not be the smallest one where rows are redundant.
    """
    nv, m, rank = tables.nv, tables.m, int(space.tail[1])
    rates, multipliers = result[:nv], result[nv:]
    for c in range(nv):
        rates[c] = rates[c] + passive[c] - bias_force[c]
    to_metric(tables, space, rates)
    if tables.path == SPARSE:
        multipliers[:] = np.nan
        if rank > 0:
            turned = tables.turned
            turn_in(tables, space, rates, turned)
            solve_rows(tables, space, bias, -1.0, turned)
            turn_back(tables, space, turned, rates)
    else:
        multipliers[:] = 0.0
        basis, rows, sigma, surplus = space.basis, space.rows, space.sigma, tables.along
        for i in range(rank):
            surplus[i] = dot_with_row(basis, i, rates)
            surplus[i] += dot_with_row(rows, i, bias) / sigma[i]
        for i in range(rank):
            for c in range(nv):
                rates[c] -= surplus[i] * basis[i, c]
            for j in range(m):
                multipliers[j] += rows[i, j] * (surplus[i] / sigma[i])
    from_metric(tables, space, rates)


@inner
def correction_of(tables: Tables, space: Packed, residual: Array, change: Array) -> None:
    """Fill ``change`` (nv,) with D⁻¹Wᵀ(W D⁻¹Wᵀ)⁺ residual."""
    change[:] = 0.0
    rank = int(space.tail[1])
    if tables.path == SPARSE:
        turned = tables.turned
        turned[:] = 0.0
        solve_rows(tables, space, residual, 1.0, turned)
        turn_back(tables, space, turned, change)
    else:
        basis, rows, sigma = space.basis, space.rows, space.sigma
        for i in range(rank):
            along = dot_with_row(rows, i, residual) / sigma[i]
            for c in range(change.size):
                change[c] += along * basis[i, c]
    from_metric(tables, space, change)


@inner
def close_rates(tables: Tables, space: Packed, rates: Array) -> None:
    """Replace rates v by v - D⁻¹Wᵀ(W D⁻¹Wᵀ)⁺ W v."""
    lift(tables, space, rates)
    free_part(tables, space, rates)
    from_metric(tables, space, rates)
