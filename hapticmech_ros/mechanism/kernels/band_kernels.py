# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A = L⁻¹Wᵀ of closures that each reach few rates: QR inside a band, linear in their number.

Columns of A are taken in the order of the first place that they reach, in which Householder
reflections of those before fill them only as far as these reach (George and Heath, Solution of
sparse linear least squares problems using Givens rotations, 1980). A column with only rounding left
follows from those before it, and is left out: a redundant row. Where that is unclear, where the
rank is not the usual one, or where the rows are nearly dependent altogether, the result is
NOT_DECIDED, and the dense factorisation decides.

Places that many columns reach are left out of the band, at its border: a platform's on its legs.
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

from hapticmech_ros.compilation import inner, leaf, local, put, shaped
from hapticmech_ros.mechanism.kernels.articulated_kernels import pair_to_metric
from hapticmech_ros.mechanism.kernels.model import Data, Model
from hapticmech_ros.mechanism.tolerances import PASSING, RESOLVED, SOLVER_RANK_TOLERANCE
from hapticmech_ros.numerics import Array
from hapticmech_ros.numerics.small_matrices import add_scaled, cholesky, dot

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
            add_scaled(square[i, : i + 1], basis[j, i], basis[j])
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
    # The reflections of the unit matrix's first columns, from the last one on.
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
    along[:] = 0.0
    for j in range(m):
        add_scaled(along[k + 1 :], 2.0 * basis[j, k], basis[j, k + 1 :])
    for j in range(m):
        add_scaled(basis[j, k + 1 :], -basis[j, k], along[k + 1 :])


@inner
def keep_free(model: Model, data: Data, pivots: Array, turned: Array) -> None:
    """Keep the free part of a vector, turned by the band's reflections.

    Args:
        model: the mechanism's.
        data: factored.
        pivots: (m,) at the rows' pivots, by ``sequence``; replaced.
        turned: (nv,) by places; those of the border are replaced.
    """
    basis, m, p = data.shares, pivots.size, model.border
    first, free = model.nv - p, local(p)
    free[:] = 0.0
    for j in range(m):
        add_scaled(free, pivots[j], basis[j])
    for i in range(p):
        add_scaled(free, turned[first + i], basis[m + i])
    for j in range(m):
        pivots[j] = dot(basis[j], free)
    for i in range(p):
        turned[first + i] = dot(basis[m + i], free)


# Columns of ``Data.row_places``.
BEGIN, PIVOT, INVERSE, LAST, FIRST = range(5)
# A smallest singular value below this share of the largest row is for the dense factorisation.
WELL_DETERMINED = PASSING
# Above this share R's smallest one will do for A's, which is larger where there is a border.
CLEAR = 0.1
# How much the estimate of the smallest singular value may be too large.
_DOUBT = 10.0
NOT_DECIDED = -1_000_000
_ROUNDS = 2


@inner
def factor_band(model: Model, data: Data, tolerance: float) -> int:
    """Fill ``band`` and ``row_places``; return the rank, or NOT_DECIDED.

    Args:
        model: the mechanism's.
        data: with joint axes, inertias and wrenches filled, and ``pivots``.
        tolerance: share of the largest row below which a row's rest is rounding.
    """
    places, band, column, rounding = data.row_places, data.band, model.turned, model.rounding[0]
    sequence, pairs, units, width = model.sequence, data.pairs, model.units, model.width
    edge, free, hit, rank, longest, largest = model.nv - model.border, 0, 0, 0, 0.0, 0.0
    for j in range(model.m):
        at = sequence[j]
        row, low, last, a, b = at[0], at[1], at[2], at[3], at[4]
        while hit < j and places[hit, LAST] < low:
            hit += 1
        begin = low
        if hit < j:
            begin = min(low, int(places[hit, PIVOT]))
        else:
            free = max(free, low)
        for i in range(hit, j):
            last = max(last, int(places[i, LAST]))
        if last - begin >= width:
            return NOT_DECIDED
        column[begin : last + 1] = 0.0
        column[edge : model.nv] = 0.0
        pair_to_metric(model, data, a, b, pairs[row], 1.0 / units[row], column)
        square = 0.0
        for place in range(begin, last + 1):
            square += column[place] * column[place]
        for place in range(edge, model.nv):
            square += column[place] * column[place]
        if square > longest:
            longest, largest = square, np.sqrt(square)
        for i in range(hit, j):
            if places[i, PIVOT] >= 0.0:
                _reflect(places, band, i, column)
        left = 0.0
        for place in range(free, last + 1):
            left += column[place] * column[place]
        left = np.sqrt(left)
        if not np.isfinite(left):
            return NOT_DECIDED
        places[j, BEGIN], places[j, FIRST] = begin, hit
        put(band[j, : last + 1 - begin], column[begin : last + 1])
        resolved = max(RESOLVED * largest, rounding)
        if left <= max(resolved, tolerance * largest) and model.border == 0:
            if tolerance <= SOLVER_RANK_TOLERANCE and left > resolved:
                return NOT_DECIDED
            places[j, PIVOT], places[j, LAST], places[j, INVERSE] = -1.0, -1.0, 0.0
            continue
        if left <= max(WELL_DETERMINED * largest, rounding):
            return NOT_DECIDED
        head = column[free]
        goal = -left if head > 0.0 else left
        share = 1.0 / np.sqrt(2.0 * left * (left + abs(head)))
        for place in range(free, last + 1):
            band[j, place - begin] = column[place] * share
        band[j, free - begin] = (head - goal) * share
        places[j, PIVOT], places[j, LAST], places[j, INVERSE] = free, last, 1.0 / goal
        if model.border > 0:
            _share(places, band, data.shares, j, column[edge : model.nv])
        free += 1
        rank += 1
    if model.border > 0 and not factor_border(data):
        return NOT_DECIDED
    if model.independent >= 0 and rank != model.independent:
        return NOT_DECIDED
    least = _least(model, data, rank, False) / largest if rank > 0 else 1.0
    if model.border > 0 and not least > CLEAR:
        least = _least(model, data, rank, True) / largest
    if not least > max(WELL_DETERMINED, _DOUBT * tolerance):
        return NOT_DECIDED
    data.tail.least_sigma, data.tail.resolved_rank = least, rank
    return rank


@inner
def _share(places: Array, band: Array, shares: Array, j: int, own: Array) -> None:
    """Fill row j of ``shares`` with -S's, from column j of A at the border."""
    begin, inverse = int(places[j, BEGIN]), places[j, INVERSE]
    for k in range(own.size):
        shares[j, k] = -own[k]
    for i in range(int(places[j, FIRST]), j):
        add_scaled(shares[j], -band[j, int(places[i, PIVOT]) - begin], shares[i])
    for k in range(own.size):
        shares[j, k] *= inverse


@leaf
def _reflect(places: Array, band: Array, j: int, vector: Array) -> None:
    """Apply reflection j to a vector by places."""
    begin, pivot, last = int(places[j, BEGIN]), int(places[j, PIVOT]), int(places[j, LAST])
    reached, normal = vector[pivot : last + 1], band[j, pivot - begin : last + 1 - begin]
    add_scaled(reached, -2.0 * dot(normal, reached), normal)


@inner
def turn_in(model: Model, data: Data, vector: Array, turned: Array) -> None:
    """Fill ``turned`` (nv,), by places, with Qᵀ vector (nv,)."""
    order, places, band = model.order, data.row_places, data.band
    for row in range(order.size):
        turned[order[row]] = vector[row]
    for j in range(places.shape[0]):
        if places[j, PIVOT] >= 0.0:
            _reflect(places, band, j, turned)


@inner
def turn_back(model: Model, data: Data, turned: Array, vector: Array) -> None:
    """Fill ``vector`` (nv,) with Q turned (nv,); ``turned`` is used up."""
    order, places, band = model.order, data.row_places, data.band
    for j in range(places.shape[0] - 1, -1, -1):
        if places[j, PIVOT] >= 0.0:
            _reflect(places, band, j, turned)
    for row in range(order.size):
        vector[row] = turned[order[row]]


@inner
def clear_pivots(model: Model, data: Data, turned: Array) -> None:
    """Keep the free part of a turned vector: zero along the closures' directions."""
    places = data.row_places
    if model.border > 0:
        across = model.across
        for j in range(across.size):
            across[j] = turned[int(places[j, PIVOT])]
        keep_free(model, data, across, turned)
        for j in range(across.size):
            turned[int(places[j, PIVOT])] = across[j]
        return
    for j in range(places.shape[0]):
        pivot = int(places[j, PIVOT])
        if pivot >= 0:
            turned[pivot] = 0.0


@inner
def solve_rows(model: Model, data: Data, needed: Array, scale: float, turned: Array) -> None:
    """Change a turned vector (nv,) least to make Aᵀ of it ``scale`` times needed (m,) / unit."""
    places, band, sequence = data.row_places, data.band, model.sequence
    units, across = model.units, model.across
    for j in range(places.shape[0]):
        pivot = int(places[j, PIVOT])
        if pivot < 0:
            continue
        row = sequence[j, 0]
        total = scale * needed[row] / units[row]
        before = turned[pivot]
        turned[pivot] = (total - _above(places, band, j, turned)) * places[j, INVERSE]
        if model.border > 0:
            across[j] = before - turned[pivot]
    if model.border > 0:
        keep_free(model, data, across, turned)
        for j in range(across.size):
            turned[int(places[j, PIVOT])] += across[j]


@leaf
def _above(places: Array, band: Array, j: int, turned: Array) -> float:
    """Return the product of column j of R, over its diagonal, and a turned vector."""
    begin, total = int(places[j, BEGIN]), 0.0
    for i in range(int(places[j, FIRST]), j):
        pivot = int(places[i, PIVOT])
        if pivot >= 0:
            total += band[j, pivot - begin] * turned[pivot]
    return total


@inner
def _least(model: Model, data: Data, rank: int, bordered: bool) -> float:
    """Return an estimate from above of R's smallest singular value, by inverse iteration; or A's.

    Args:
        model: the mechanism's.
        data: factored.
        rank: r.
        bordered: whether it is to be that of A, with a border.
    """
    places, band, m = data.row_places, data.band, model.m
    turned, before, size = model.turned, model.along, np.sqrt(float(rank))
    before[:] = 1.0
    for _ in range(_ROUNDS):
        share = 1.0 / size
        for j in range(m):
            pivot = int(places[j, PIVOT])
            if pivot >= 0:
                total = before[j] * share - _above(places, band, j, turned)
                turned[pivot] = total * places[j, INVERSE]
        if bordered:
            _weaken(model, data, turned)
        square = 0.0
        for j in range(m - 1, -1, -1):
            pivot = int(places[j, PIVOT])
            if pivot < 0:
                continue
            before[j] = turned[pivot] * places[j, INVERSE]
            square += before[j] * before[j]
            begin = int(places[j, BEGIN])
            for i in range(int(places[j, FIRST]), j):
                above = int(places[i, PIVOT])
                if above >= 0:
                    turned[above] -= band[j, above - begin] * before[j]
        size = np.sqrt(square)
    return float(1.0 / np.sqrt(size))


@inner
def _weaken(model: Model, data: Data, turned: Array) -> None:
    """Replace the pivots z of a turned vector by (1 + S Sᵀ)⁻¹ z: AᵀA is Rᵀ (1 + S Sᵀ) R."""
    places, across = data.row_places, model.across
    turned[model.nv - model.border :] = 0.0
    for j in range(across.size):
        across[j] = turned[int(places[j, PIVOT])]
    keep_free(model, data, across, turned)
    for j in range(across.size):
        turned[int(places[j, PIVOT])] -= across[j]
