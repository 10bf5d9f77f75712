# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Kernels of Eq. 1 at a configuration: factorisation of D and W, accelerations, projections.

Every kernel takes the mechanism's constants as ``numbers`` and ``values`` (see
:mod:`~hapticmech_ros.mechanism.kernels.model`), and the terms at a configuration as one array
``packed`` (see :mod:`~hapticmech_ros.mechanism.kernels.model`).

W of all closures is factorised with D, dense, by SVD, or QR where that will do.
"""

from __future__ import annotations

import math

import numpy as np

from hapticmech_ros.compilation import inner, kernel, local_whole, shaped
from hapticmech_ros.mechanism.kernels.articulated_kernels import articulate
from hapticmech_ros.mechanism.kernels.band_kernels import NOT_DECIDED, factor_band
from hapticmech_ros.mechanism.kernels.closure_kernels import (
    COUPLING,
    add_gear,
    add_pair,
    end_of_rows,
    gear_error,
    residual_of,
    wrenches_of,
)
from hapticmech_ros.mechanism.kernels.many_rows import (
    FEW_ROWS,
    SOME_ROWS,
    cut,
    first_directions,
    pseudo_inverse_transposed,
    solve_lower_columns,
    triangularise,
)
from hapticmech_ros.mechanism.kernels.model import SPARSE, Data, Model
from hapticmech_ros.mechanism.kernels.tree_kernels import inertia_of, place_tree
from hapticmech_ros.mechanism.tolerances import (
    DRIFT_CAP,
    DRIFT_FACTOR,
    RESOLVED,
    SOLVER_RANK_TOLERANCE,
)
from hapticmech_ros.numerics import Array
from hapticmech_ros.numerics.small_matrices import (
    EPSILON,
    cholesky,
    dot_rows,
    largest,
    orthogonalise,
    solve_lower,
)

# A kernel's code where an SVD does not converge.
NO_SVD = -1
# Reflections suffice if R's diagonal shows that the kept directions have at least this share of the
# largest singular value: far above all limits on the smallest one.
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
            jacobian[row][:] = 0.0
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

    Return the rank; NO_SVD; or NOT_DECIDED next to a singular position: only an SVD finds how near
    it is, and cuts no more directions than necessary. With many rows it is used only where one must
    be cut.
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
    tail.least_sigma = abs(scaled[resolved - 1, resolved - 1]) / first
    tail.resolved_rank = resolved
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
        tail.least_sigma, tail.resolved_rank = length / longest, i + 1
        if length > tolerance * longest:
            sigma[i] = length
            rank += 1
    return rank


# Codes of a kernel that failed, beside ``NO_SVD`` and ``band_kernels.NOT_DECIDED``; below SINGULAR:
# D is not positive definite at degree of freedom SINGULAR - code.
NOT_FINITE, SINGULAR = -2, -3


@inner
def locate(model: Model, q: Array, data: Data) -> None:
    """Fill ``data`` with all poses at a configuration, and how far loops are open."""
    closures, poses, residual, pairs = model.closures, data.poses, data.residual, data.pairs
    place_tree(model, q, data)
    for index in range(closures.shape[0]):
        row_of = closures[index]
        kind, a, b, first = row_of[0], row_of[1], row_of[2], row_of[3]
        if kind == COUPLING:
            residual[first] = gear_error(model, poses, a, b, q)
            pairs[first, :] = 0.0
            continue
        residual_of(kind, poses, a, b, first, residual)
        wrenches_of(kind, poses, a, b, first, pairs)
    data.tail.largest_residual = largest(residual)


@inner
def factorise(model: Model, data: Data) -> int:
    """Fill the rest of ``data`` where :func:`locate` was; see :func:`factor`."""
    residual, lengths, tail = data.residual, model.lengths, data.tail
    drift = 0.0
    for i in range(model.m):
        drift = max(drift, abs(residual[i] / lengths[i]))
    tolerance = max(SOLVER_RANK_TOLERANCE, min(DRIFT_FACTOR * drift, DRIFT_CAP))
    tail.rank, tail.least_sigma, tail.resolved_rank = 0.0, 1.0, 0.0
    tail.potential_energy = math.inf
    rank = NOT_DECIDED
    if model.path == SPARSE:
        bad = articulate(model, data)
        if bad < 0:
            rank = factor_band(model, data, tolerance)
    else:
        inertia_of(model, data, data.factor)
        bad = cholesky(data.factor, data.factor)
        if bad < 0:
            rank = factor_dense(model, data, tolerance)
    if bad >= 0:
        return SINGULAR - bad
    tail.rank = max(rank, 0)
    return rank


@kernel("int64(Model, float64[::1], Data)")
def factor(model: Model, q: Array, data: Data) -> int:
    """Fill ``data`` at a configuration.

    Args:
        model: constants of the mechanism.
        q: (nq,) configuration.
        data: to fill.

    Returns:
        The rank r; or NO_SVD, SINGULAR and below, or NOT_DECIDED of a sparse factorisation.
    """
    locate(model, q, data)
    return factorise(model, data)
