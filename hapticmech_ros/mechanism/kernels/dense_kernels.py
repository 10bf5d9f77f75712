# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""W of all closures, dense, and its factorisation with that of D: SVD, or QR where that will do."""

from __future__ import annotations

import numpy as np

from hapticmech_ros.arrays import Array
from hapticmech_ros.compilation import inner, local_whole, shaped
from hapticmech_ros.mechanism.kernels.band_kernels import NOT_DECIDED
from hapticmech_ros.mechanism.kernels.closure_kernels import COUPLING, end_of_rows
from hapticmech_ros.mechanism.kernels.data import Data
from hapticmech_ros.mechanism.kernels.many_rows import (
    FEW_ROWS,
    SOME_ROWS,
    cut,
    first_directions,
    pseudo_inverse_transposed,
    solve_lower_columns,
    triangularise,
)
from hapticmech_ros.mechanism.kernels.model import Model
from hapticmech_ros.mechanism.kernels.pair_kernels import add_gear, add_pair
from hapticmech_ros.mechanism.kernels.small_matrices import (
    EPSILON,
    dot_rows,
    orthogonalise,
    solve_lower,
)
from hapticmech_ros.mechanism.kernels.step_layout import LEAST, RESOLVED_RANK
from hapticmech_ros.mechanism.tolerances import RESOLVED

# What a kernel returns where an SVD does not converge.
NO_SVD = -1
# Reflections do for the directions kept if R's diagonal says that they have at least this share of
# the largest singular value: far from all limits that ask for the smallest one.
APART = 1e-2


@inner
def factor_dense(model: Model, data: Data, tolerance: float) -> int:
    """Fill W, basis, σ and rows; return the rank, or NO_SVD."""
    m, axes, jacobian, pairs = model.m, data.joint_jacobian, data.jacobian, data.pairs
    if m == 0:
        return 0
    closures, carriers, joints = model.closures, model.carriers, model.joints
    for index in range(closures.shape[0]):
        row_of = closures[index]
        kind, a, b, first = row_of[0], row_of[1], row_of[2], row_of[3]
        for row in range(first, end_of_rows(closures, index, m)):
            for c in range(jacobian.shape[1]):
                jacobian[row, c] = 0.0
            add_pair(joints, axes, carriers[a], carriers[b], pairs[row], 1.0, jacobian[row])
        if kind == COUPLING:
            add_gear(model, data.poses, a, b, jacobian[first])
    rank = NOT_DECIDED
    if m >= SOME_ROWS:
        rank = _resolve_by_reflections(model, tolerance, data)
    if rank == NOT_DECIDED:
        rank = _resolve_by_rotations(model, tolerance, data)
    return rank


@inner
def _resolve_by_rotations(model: Model, tolerance: float, data: Data) -> int:
    """Fill basis, σ and rows by an SVD; return the rank, or NO_SVD.

    From some rows on a QR comes first: of its R Jacobi's rotations need half as many sweeps, along
    shorter rows (Drmač and Veselić, New fast and accurate Jacobi SVD algorithm, 2008).
    """
    jacobian, factor, units = data.jacobian, data.factor, model.units
    m, nv = jacobian.shape
    if m >= SOME_ROWS:
        return _resolve_some(model, tolerance, data)
    scaled, turn = model.scaled, model.turn
    for i in range(m):
        for c in range(nv):
            scaled[i, c] = jacobian[i, c] / units[i]
        solve_lower(factor, scaled[i])
    if not orthogonalise(scaled, turn):
        return NO_SVD
    basis, rows = data.basis, data.rows
    rank = _kept(scaled, tolerance, model.rounding[0], data)
    for i in range(rank):
        for c in range(nv):
            basis[i, c] = scaled[i, c] / data.sigma[i]
        for j in range(m):
            rows[i, j] = turn[i, j] / units[j]
    return rank


@inner
def _resolve_some(model: Model, tolerance: float, data: Data) -> int:
    """Do the same by a QR with pivoting, and an SVD of its R."""
    basis, rows, units = data.basis, data.rows, model.units
    m, nv = data.jacobian.shape
    columns, directions, reflectors, sums = (
        model.columns,
        model.directions,
        model.reflectors,
        model.sums,
    )
    if not _columns_of(model, data):
        return NO_SVD
    order = local_whole(m)
    count = triangularise(columns, min(m, nv), EPSILON, order, reflectors, sums)
    first_directions(reflectors, count, nv, sums[0], directions)
    upper = shaped(model.scaled, (count, m))
    turn = shaped(model.turn, (count, count))
    for i in range(count):
        for j in range(m):
            upper[i, j] = columns[i, j] if j >= i else 0.0
    if not orthogonalise(upper, turn):
        return NO_SVD
    rank = _kept(upper, tolerance, model.rounding[0], data)
    for i in range(rank):
        for c in range(nv):
            total = 0.0
            for k in range(count):
                total += turn[i, k] * directions[c, k]
            basis[i, c] = total
        for j in range(m):
            rows[i, order[j]] = upper[i, j] / (data.sigma[i] * units[order[j]])
    return rank


@inner
def _columns_of(model: Model, data: Data) -> bool:
    """Fill ``model.columns`` (nv, m) with L⁻¹Wᵀ of scaled rows; return whether all is finite."""
    jacobian, units, columns = data.jacobian, model.units, model.columns
    m, nv = jacobian.shape
    for c in range(nv):
        for i in range(m):
            columns[c, i] = jacobian[i, c] / units[i]
            if not np.isfinite(columns[c, i]):
                return False
    solve_lower_columns(data.factor, columns)
    return True


@inner
def _resolve_by_reflections(model: Model, tolerance: float, data: Data) -> int:
    """Fill basis and rows as an SVD does, but for a rotation of both; σ are R's diagonal.

    Return the rank; NO_SVD; or NOT_DECIDED next to a singular position: only an SVD says how near,
    and cuts no more than needs be. Of many rows it is asked only where something has to be cut.
    """
    m, nv = data.jacobian.shape
    units, sums, scaled = model.units, model.sums, model.columns
    if not _columns_of(model, data):
        return NO_SVD
    order, reflectors = local_whole(m), model.reflectors
    resolved = triangularise(scaled, data.sigma.size, RESOLVED, order, reflectors, sums)
    while resolved > 0 and not abs(scaled[resolved - 1, resolved - 1]) > model.rounding[0]:
        resolved -= 1
    if resolved == 0:
        return 0
    first, kept = abs(scaled[0, 0]), resolved
    while kept > 0 and not abs(scaled[kept - 1, kept - 1]) > tolerance * first:
        kept -= 1
    apart = kept > 0 and abs(scaled[kept - 1, kept - 1]) > APART * first
    if not apart and (kept < resolved or m <= FEW_ROWS):
        return NOT_DECIDED
    tail, sigmas, basis, rows = data.tail, data.sigma, data.basis, data.rows
    tail[LEAST], tail[RESOLVED_RANK] = abs(scaled[resolved - 1, resolved - 1]) / first, resolved
    directions, inverse = model.directions, model.inverse
    if kept == resolved:
        for i in range(kept):
            sigmas[i] = abs(scaled[i, i])
        first_directions(reflectors, kept, nv, sums[0], directions)
        pseudo_inverse_transposed(scaled, kept, model.inverting, sums, inverse)
    elif not cut(
        scaled, resolved, kept, reflectors, model.inverting, sums, sigmas, directions, inverse
    ):
        return NOT_DECIDED
    for i in range(kept):
        for c in range(nv):
            basis[i, c] = directions[c, i]
        for j in range(m):
            rows[i, order[j]] = inverse[i, j] * sigmas[i] / units[order[j]]
    return kept


@inner
def _kept(orthogonal: Array, tolerance: float, rounding: float, data: Data) -> int:
    """Fill σ, the lengths of orthogonal rows, of the directions that carry force; return how many.

    Rows are in the order of their lengths.
    """
    longest = np.sqrt(dot_rows(orthogonal, 0, 0)) if orthogonal.shape[0] > 0 else 0.0
    rank, sigma, tail = 0, data.sigma, data.tail
    for i in range(min(sigma.size, orthogonal.shape[0])):
        length = np.sqrt(dot_rows(orthogonal, i, i))
        if not length > max(RESOLVED * longest, rounding):
            break
        tail[LEAST], tail[RESOLVED_RANK] = length / longest, i + 1
        if length > tolerance * longest:
            sigma[i] = length
            rank += 1
    return rank
