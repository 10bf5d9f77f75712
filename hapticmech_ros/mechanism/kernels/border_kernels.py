# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Rates that many closures share, at a sparse factorisation's border: a platform's on its legs.

Where every closure reaches places of its own and a few that it shares with others, A = L⁻¹Wᵀ is
[B; P], with B in the band and P at the border (a bordered block-diagonal matrix, dual
block-angular: Golub, Plemmons and Sameh, Parallel block schemes for large-scale least-squares
computations, 1988). With B = Q R and S = P R⁻¹ the motions that the closures leave free are those
of the band's places without pivots, and in the others the columns of [-S, 1]ᵀ, which are made
orthonormal. Reflections of A itself would fill all rows of the band. All loops run along rows, a
few numbers each, whose sums do not wait for each other.
"""

from __future__ import annotations

import numpy as np

from hapticmech_ros.arrays import Array
from hapticmech_ros.compilation import inner, local, shaped
from hapticmech_ros.mechanism.kernels.data import Data
from hapticmech_ros.mechanism.kernels.model import Model
from hapticmech_ros.mechanism.kernels.small_matrices import cholesky

# Up to this square of a column of [-S, 1]ᵀ the factor of their products will do: rounding is
# magnified by no more.
MODERATE = 100.0


@inner
def factor_border(data: Data) -> bool:
    """Replace -S in the first rows of ``data.shares`` by an orthonormal basis of [-S, 1]ᵀ.

    Returns:
        Whether all numbers are finite.
    """
    basis = data.shares
    p = basis.shape[1]
    m = basis.shape[0] - p
    square = shaped(local(p * p), (p, p))
    for i in range(p):
        for k in range(p):
            square[i, k] = 1.0 if i == k else 0.0
    for j in range(m):
        for i in range(p):
            share = basis[j, i]
            for k in range(i + 1):
                square[i, k] += share * basis[j, k]
    largest = 0.0
    for i in range(p):
        if not np.isfinite(square[i, i]):
            return False
        largest = max(largest, square[i, i])
    if largest > MODERATE or cholesky(square, square) >= 0:
        _reflect_unit(basis, m)
        return True
    inverses = local(p)
    for k in range(p):
        inverses[k] = 1.0 / square[k, k]
        for other in range(p):
            basis[m + k, other] = 1.0 if other == k else 0.0
    for j in range(m + p):
        for k in range(p):
            total = basis[j, k]
            for i in range(k):
                total -= basis[j, i] * square[k, i]
            basis[j, k] = total * inverses[k]
    return True


@inner
def _reflect_unit(basis: Array, m: int) -> None:
    """Do the same by Householder's reflections, whose rounding a large S does not magnify."""
    p = basis.shape[1]
    heads, along = local(p), local(p)
    # The reflection of column k leaves the ones of later columns alone.
    for k in range(p):
        square = 0.0
        for j in range(m):
            square += basis[j, k] * basis[j, k]
        length = np.sqrt(1.0 + square)
        share = 1.0 / np.sqrt(2.0 * length * (length + 1.0))
        heads[k] = (1.0 + length) * share
        for j in range(m):
            basis[j, k] *= share
        _remove(basis, m, k, along)
    # What the reflections make of the first columns of the unit matrix, from the last one on.
    for k in range(p - 1, -1, -1):
        _remove(basis, m, k, along)
        for j in range(m):
            basis[j, k] *= -2.0 * heads[k]
        for other in range(p):
            basis[m + k, other] = -heads[k] * along[other] if other > k else 0.0
        basis[m + k, k] = 1.0 - 2.0 * heads[k] * heads[k]


@inner
def _remove(basis: Array, m: int, k: int, along: Array) -> None:
    """Reflect the later columns by column k; fill ``along`` with twice their products with it."""
    p = basis.shape[1]
    for other in range(p):
        along[other] = 0.0
    for j in range(m):
        share = 2.0 * basis[j, k]
        for other in range(k + 1, p):
            along[other] += share * basis[j, other]
    for j in range(m):
        share = basis[j, k]
        for other in range(k + 1, p):
            basis[j, other] -= share * along[other]


@inner
def keep_free(model: Model, data: Data, pivots: Array, turned: Array) -> None:
    """Keep what the closures leave free of a vector, turned by the band's reflections.

    Args:
        model: the mechanism's.
        data: factored.
        pivots: (m,) at the rows' pivots, by ``sequence``; replaced.
        turned: (nv,) by places; those of the border are replaced.
    """
    basis, m, p = data.shares, pivots.size, model.border
    first, free = model.nv - p, local(p)
    for k in range(p):
        free[k] = 0.0
    for j in range(m):
        for k in range(p):
            free[k] += basis[j, k] * pivots[j]
    for i in range(p):
        for k in range(p):
            free[k] += basis[m + i, k] * turned[first + i]
    for j in range(m):
        total = 0.0
        for k in range(p):
            total += basis[j, k] * free[k]
        pivots[j] = total
    for i in range(p):
        total = 0.0
        for k in range(p):
            total += basis[m + i, k] * free[k]
        turned[first + i] = total
