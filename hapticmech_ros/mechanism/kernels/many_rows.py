# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Factorisation of closure rows, as loops inside kernels: a rank-revealing QR, not an SVD.

One-sided Jacobi turns every pair of rows several times: m² n each. Here A P = Q R by Householder
reflections with column pivoting takes 2 m² n once, and where rows depend on each other a second QR,
Rᵀ = Y Tᵀ, gives the same pseudo-inverse Q T⁻ᵀ Yᵀ Pᵀ as the SVD does (the complete orthogonal
factorisation of Golub and Van Loan, Matrix Computations, 5.4.7). All loops run along rows of
memory, which compilers vectorise without changing the order of a sum.
"""

from __future__ import annotations

import numpy as np

from hapticmech_ros.compilation import inner, local_whole, shaped
from hapticmech_ros.numerics import Array
from hapticmech_ros.numerics.small_matrices import EPSILON, add_scaled, clear

# QR takes less time from so many rows on; and an SVD is then that of R.
SOME_ROWS = 4
# Up to this many an SVD is worth its time wherever a σ is small, not only where one may be cut.
FEW_ROWS = 16


@inner
def solve_lower_columns(factor: Array, columns: Array) -> None:
    """Replace (n, m) columns by L⁻¹ columns."""
    size, count = columns.shape
    for i in range(size):
        for k in range(i):
            share = factor[i, k]
            if share != 0.0:
                add_scaled(columns[i], -share, columns[k])
        pivot = factor[i, i]
        for j in range(count):
            columns[i, j] /= pivot


@inner
def triangularise(
    matrix: Array, most: int, tolerance: float, order: Array, reflectors: Array, sums: Array
) -> int:
    """Replace (n, m) A by R of A P = Q R, rows below the rank left undefined; return the rank.

    Args:
        matrix: A.
        most: largest rank there may be.
        tolerance: a diagonal entry of R below this share of the first one ends it; negative:
            columns keep their order, and all count.
        order: (m,) to fill: column j of A P is column order[j] of A.
        reflectors: (most, n) to fill: the unit vectors w of Q = (1 - 2 w₁w₁ᵀ)(1 - 2 w₂w₂ᵀ)...
        sums: (2, m or more) to work in.
    """
    size, count = matrix.shape
    squares, along = sums[0], sums[1]
    for j in range(count):
        order[j] = j
    first = 0.0
    for r in range(most):
        pivot = r
        if tolerance >= 0.0:
            # Computed anew each time: a square that is only put down loses its digits.
            squares[r:count] = 0.0
            for i in range(r, size):
                for j in range(r, count):
                    squares[j] += matrix[i, j] * matrix[i, j]
            for j in range(r + 1, count):
                if squares[j] > squares[pivot]:
                    pivot = j
            if pivot != r:
                order[r], order[pivot] = order[pivot], order[r]
                for i in range(size):
                    matrix[i, r], matrix[i, pivot] = matrix[i, pivot], matrix[i, r]
        length = 0.0
        for i in range(r, size):
            length += matrix[i, r] * matrix[i, r]
        length = np.sqrt(length)
        if r == 0:
            first = length
        if not length > max(tolerance, 0.0) * first:
            return r
        _reflect(matrix, r, length, along, reflectors[r])
    return most


@inner
def _reflect(matrix: Array, r: int, length: float, along: Array, normal: Array) -> None:
    """Turn column r, of ``length`` from row r on, onto that row; keep the mirror's unit normal."""
    size, count = matrix.shape
    head = matrix[r, r]
    # Away from the column's own side: nothing cancels.
    goal = -length if head > 0.0 else length
    norm = np.sqrt(2.0 * length * (length + abs(head)))
    normal[:r] = 0.0
    for i in range(r, size):
        normal[i] = matrix[i, r] / norm
    normal[r] = (head - goal) / norm
    mirror(matrix, r, r + 1, count, normal, along)
    matrix[r, r] = goal
    for i in range(r + 1, size):
        matrix[i, r] = 0.0


@inner
def mirror(matrix: Array, row: int, start: int, end: int, normal: Array, along: Array) -> None:
    """Apply 1 - 2 w wᵀ, where w is zero before ``row``, to columns ``start`` to ``end``."""
    size = matrix.shape[0]
    products = along[start:end]
    products[:] = 0.0
    for i in range(row, size):
        if normal[i] != 0.0:
            add_scaled(products, normal[i], matrix[i, start:end])
    for i in range(row, size):
        if normal[i] != 0.0:
            add_scaled(matrix[i, start:end], -2.0 * normal[i], products)


@inner
def first_directions(reflectors: Array, rank: int, size: int, along: Array, found: Array) -> None:
    """Fill the first ``rank`` columns of ``found`` (size, ...) with those of Q.

    ``along`` (rank or more,) is to work in.
    """
    clear(found[:size], rank)
    for i in range(rank):
        found[i, i] = 1.0
    for r in range(rank - 1, -1, -1):
        # Columns before r are still those of the identity, which this mirror leaves alone.
        mirror(found, r, r, rank, reflectors[r], along)


@inner
def inverse_transposed(upper: Array, size: int, found: Array) -> None:
    """Fill ``found`` (size, size) with R⁻ᵀ of an upper triangular R, which may be wider."""
    clear(found[:size], size)
    for i in range(size):
        found[i, i] = 1.0
        for k in range(i):
            share = upper[k, i]
            if share != 0.0:
                add_scaled(found[i, : k + 1], -share, found[k])
        pivot = upper[i, i]
        for j in range(i + 1):
            found[i, j] /= pivot


@inner
def pseudo_inverse_transposed(
    upper: Array, rank: int, workspace: Array, sums: Array, found: Array
) -> None:
    """Fill the first rows of ``found`` with (Rᵀ)⁺ (rank, m), R (n, m) upper trapezoidal.

    Args:
        upper: R.
        rank: number of its rows that count.
        workspace: (3, rank m or more) to work in.
        sums: (2, m or more) to work in.
        found: (rank or more, m) to fill.
    """
    count = upper.shape[1]
    if rank == count:
        inverse_transposed(upper, rank, found)
        return
    turned, order = shaped(workspace[0], (count, rank)), local_whole(rank)
    for i in range(rank):
        for j in range(count):
            turned[j, i] = upper[i, j] if j >= i else 0.0
    reflectors, basis = shaped(workspace[1], (rank, count)), shaped(workspace[2], (count, rank))
    triangularise(turned, rank, -1.0, order, reflectors, sums)
    # Rᵀ = Y T, so that its pseudo-inverse is T⁻¹ Yᵀ: solve T Z = Yᵀ from below.
    first_directions(reflectors, rank, count, sums[0], basis)
    for i in range(rank - 1, -1, -1):
        for j in range(count):
            found[i, j] = basis[j, i]
        for k in range(i + 1, rank):
            share = turned[i, k]
            if share != 0.0:
                add_scaled(found[i, :count], -share, found[k])
        pivot = turned[i, i]
        for j in range(count):
            found[i, j] /= pivot


@inner
def cut(
    upper: Array,
    resolved: int,
    kept: int,
    reflectors: Array,
    workspace: Array,
    sums: Array,
    sigmas: Array,
    directions: Array,
    found: Array,
) -> bool:
    """Factorise A without its smallest singular values, those of R's rows after the first ones.

    With R = [R₁; R₂], R₂ small, the rows of R₁ span the right singular vectors that are kept to the
    square of |R₂| over the smallest σ kept. Each step of a simultaneous iteration with RᵀR takes
    the error down by that factor (Golub and Van Loan, Matrix Computations, 8.2.4), until it is
    rounding. With Z, an orthonormal basis of them, A P Z is made triangular once more.

    Args:
        upper: R (n, m), of A P = Q R.
        resolved: its rows.
        kept: how many of them R₁ has.
        reflectors: of Q.
        workspace: (3, resolved m or more) to work in.
        sums: (2, max(m, n) or more) to work in.
        sigmas: to fill with the diagonal of the second R.
        directions: (n, kept or more) to fill with an orthonormal basis of A P Z.
        found: (kept or more, m) to fill with (A P Z Zᵀ)⁺ᵀ in that basis.

    Returns:
        Whether all directions kept are resolved.
    """
    size, count = upper.shape
    order, here, there = local_whole(kept), 0, 2
    turned, space = shaped(workspace[0], (count, kept)), shaped(workspace[2], (count, kept))
    for i in range(kept):
        for j in range(count):
            turned[j, i] = upper[i, j] if j >= i else 0.0
    _span(turned, shaped(workspace[1], (kept, count)), order, sums, space)
    product = shaped(workspace[0], (resolved, kept))
    _times(upper, space, product)
    share = upper[kept, kept] / upper[kept - 1, kept - 1]
    factor = error = share * share
    while error > EPSILON:
        turned = shaped(workspace[there], (count, kept))
        for j in range(count):
            turned[j][:] = 0.0
            for i in range(min(j + 1, resolved)):
                add_scaled(turned[j], upper[i, j], product[i])
        space, product = shaped(workspace[here], (count, kept)), shaped(turned, (resolved, kept))
        _span(turned, shaped(workspace[1], (kept, count)), order, sums, space)
        _times(upper, space, product)
        here, there, error = there, here, error * factor
    mirrors = shaped(workspace[1], (kept, resolved))
    if triangularise(product, kept, EPSILON, order, mirrors, sums) < kept:
        return False
    first_directions(mirrors, kept, resolved, sums[0], directions[:resolved])
    clear(directions[resolved:size], kept)
    for r in range(resolved - 1, -1, -1):
        mirror(directions, r, 0, kept, reflectors[r], sums[0])
    inverse = shaped(workspace[1], (kept, kept))
    inverse_transposed(product, kept, inverse)
    for i in range(kept):
        sigmas[i] = abs(product[i, i])
        for j in range(count):
            total = 0.0
            for k in range(i + 1):
                total += inverse[i, k] * space[j, order[k]]
            found[i, j] = total
    return True


@inner
def _span(columns: Array, mirrors: Array, order: Array, sums: Array, space: Array) -> None:
    """Fill ``space`` with an orthonormal basis of the columns' span; they are overwritten."""
    count, rank = columns.shape
    triangularise(columns, rank, -1.0, order, mirrors, sums)
    first_directions(mirrors, rank, count, sums[0], space)


@inner
def _times(upper: Array, space: Array, product: Array) -> None:
    """Fill ``product`` with so many rows of R times ``space``."""
    count = space.shape[0]
    for i in range(product.shape[0]):
        product[i][:] = 0.0
        for j in range(i, count):
            add_scaled(product[i], upper[i, j], space[j])
