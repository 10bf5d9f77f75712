# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A = L⁻¹Wᵀ of closures that each reach few rates: QR inside a band, linear in their number.

Columns of A are taken in the order of the first place that they reach, in which Householder
reflections of those before fill them only as far as these reach (George and Heath, Solution of
sparse linear least squares problems using Givens rotations, 1980). A column of which nothing but
rounding is left follows from those before it, and is left out: a redundant row. Where it is not
clear whether it does, where there are not as many of them as there always are, or where the rows
are nearly dependent altogether, the answer is NOT_DECIDED, and the dense factorisation has to say.

Places that many columns reach may be left out of the band: see :mod:`.border_kernels`.
"""

from __future__ import annotations

import numpy as np

from hapticmech_ros.arrays import Array
from hapticmech_ros.compilation import inner, leaf
from hapticmech_ros.mechanism.kernels.articulated_kernels import pair_to_metric
from hapticmech_ros.mechanism.kernels.border_kernels import factor_border, keep_free
from hapticmech_ros.mechanism.kernels.data import Data
from hapticmech_ros.mechanism.kernels.model import Model
from hapticmech_ros.mechanism.kernels.step_layout import LEAST, RESOLVED_RANK
from hapticmech_ros.mechanism.tolerances import PASSING, RESOLVED, SOLVER_RANK_TOLERANCE

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
        tolerance: share of the largest row below which what is left of a row says nothing.
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
        for place in range(begin, last + 1):
            column[place] = 0.0
        for place in range(edge, model.nv):
            column[place] = 0.0
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
        for place in range(begin, last + 1):
            band[j, place - begin] = column[place]
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
    data.tail[LEAST], data.tail[RESOLVED_RANK] = least, rank
    return rank


@inner
def _share(places: Array, band: Array, shares: Array, j: int, own: Array) -> None:
    """Fill row j of ``shares`` with -S's, given what column j of A has at the border."""
    begin, inverse = int(places[j, BEGIN]), places[j, INVERSE]
    for k in range(own.size):
        shares[j, k] = -own[k]
    for i in range(int(places[j, FIRST]), j):
        above = band[j, int(places[i, PIVOT]) - begin]
        for k in range(own.size):
            shares[j, k] -= above * shares[i, k]
    for k in range(own.size):
        shares[j, k] *= inverse


@leaf
def _reflect(places: Array, band: Array, j: int, vector: Array) -> None:
    """Apply reflection j to a vector by places."""
    begin, pivot, last = int(places[j, BEGIN]), int(places[j, PIVOT]), int(places[j, LAST])
    along = 0.0
    for place in range(pivot, last + 1):
        along += band[j, place - begin] * vector[place]
    along *= 2.0
    for place in range(pivot, last + 1):
        vector[place] -= along * band[j, place - begin]


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
    """Leave of a turned vector what the closures leave free: zero where their directions are."""
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
    """Change a turned vector (nv,) least so that Aᵀ of it is ``scale`` times needed (m,) / unit."""
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
    for j in range(m):
        before[j] = 1.0
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
    for k in range(model.nv - model.border, model.nv):
        turned[k] = 0.0
    for j in range(across.size):
        across[j] = turned[int(places[j, PIVOT])]
    keep_free(model, data, across, turned)
    for j in range(across.size):
        turned[int(places[j, PIVOT])] -= across[j]
