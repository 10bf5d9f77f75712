"""Kernels of Eq. 1 at a configuration: factorisation of D and W, accelerations, projections.

Every kernel takes the mechanism's constants as ``numbers`` and ``values`` (see
:mod:`~hapticmech_ros.mechanism.compiled.tables`), and what is known of a configuration as one array
``packed`` (see :mod:`~hapticmech_ros.mechanism.compiled.packed`).
"""

from __future__ import annotations

import numpy as np

from hapticmech_ros.compilation import inner, kernel
from hapticmech_ros.mechanism.compiled.closure_kernels import jacobian_of, residual_of
from hapticmech_ros.mechanism.compiled.many_rows import (
    FEW_ROWS,
    first_directions,
    pseudo_inverse_transposed,
    solve_lower_columns,
    triangularise,
)
from hapticmech_ros.mechanism.compiled.packed import Packed, unpack
from hapticmech_ros.mechanism.compiled.small_matrices import (
    cholesky,
    copy_matrix,
    dot_rows,
    dot_with_row,
    orthogonalise,
    remove,
    solve_lower,
    solve_lower_transposed,
)
from hapticmech_ros.mechanism.compiled.tables import Tables, unfold
from hapticmech_ros.mechanism.constraint_space import (
    DRIFT_CAP,
    DRIFT_FACTOR,
    RESOLVED,
    SOLVER_RANK_TOLERANCE,
)
from hapticmech_ros.mechanism.model import Array

# What a kernel returns that could not do its work; below SINGULAR: D is not positive definite at
# degree of freedom SINGULAR - code.
NO_SVD, NOT_FINITE, SINGULAR = -1, -2, -3
UNDECIDED = -1_000_000


@inner
def factor(
    tables: Tables, inertia: Array, joint_jacobian: Array, joint_poses: Array, space: Packed
) -> int:
    """Fill ``space`` at a configuration; see :func:`factor_closures`."""
    m = tables.m
    bad = cholesky(inertia, space.factor)
    if bad >= 0:
        return SINGULAR - bad
    copy_matrix(joint_jacobian, space.joint_jacobian)
    _place_frames(tables, joint_poses, space.poses)
    space.tail[0], space.tail[1], space.tail[2], space.tail[3] = 0.0, 0.0, 1.0, 0.0
    if m == 0:
        return 0
    for index in range(tables.closures.shape[0]):
        kind, a = tables.closures[index, 0], tables.closures[index, 1]
        b, first = tables.closures[index, 2], tables.closures[index, 3]
        residual_of(kind, space.poses, a, b, first, space.residual)
        support = tables.support
        jacobian_of(kind, space.poses, a, b, support, joint_jacobian, first, space.jacobian)
    worst, drift = 0.0, 0.0
    for i in range(m):
        worst = max(worst, abs(space.residual[i]))
        drift = max(drift, abs(space.residual[i] / tables.lengths[i]))
    tolerance = max(SOLVER_RANK_TOLERANCE, min(DRIFT_FACTOR * drift, DRIFT_CAP))
    rank = UNDECIDED
    if m > FEW_ROWS:
        rank = _resolve_many(tables.lengths, tolerance, space)
    if rank == UNDECIDED:
        rank = _resolve_few(tables.lengths, tolerance, space)
    space.tail[0], space.tail[1] = worst, max(rank, 0)
    return rank


@inner
def _resolve_few(lengths: Array, tolerance: float, space: Packed) -> int:
    """Fill basis, σ and rows by an SVD; return the rank, or NO_SVD."""
    m, nv = space.jacobian.shape
    scaled, turn = np.empty((m, nv)), np.empty((m, m))
    for i in range(m):
        for c in range(nv):
            scaled[i, c] = space.jacobian[i, c] / lengths[i]
        solve_lower(space.factor, scaled[i])
    if not orthogonalise(scaled, turn):
        return NO_SVD
    return _keep(scaled, turn, lengths, tolerance, space)


@inner
def _resolve_many(lengths: Array, tolerance: float, space: Packed) -> int:
    """Fill basis and rows as an SVD does, but for a rotation of both; σ are R's diagonal.

    Return the rank; NO_SVD; or UNDECIDED where more than rounding has to be cut, off the closures
    or next to a singular position: only an SVD cuts no more than needs be.
    """
    m, nv = space.jacobian.shape
    most = space.sigma.size
    scaled = np.empty((nv, m))
    for c in range(nv):
        for i in range(m):
            scaled[c, i] = space.jacobian[i, c] / lengths[i]
            if not np.isfinite(scaled[c, i]):
                return NO_SVD
    solve_lower_columns(space.factor, scaled)
    order, reflectors = np.empty(m, dtype=np.int64), np.empty((most, nv))
    resolved = triangularise(scaled, most, RESOLVED, order, reflectors)
    if resolved > 0 and not abs(scaled[resolved - 1, resolved - 1]) > tolerance * abs(scaled[0, 0]):
        return UNDECIDED
    if resolved > 0:
        space.tail[2] = abs(scaled[resolved - 1, resolved - 1] / scaled[0, 0])
    space.tail[3] = resolved
    directions = first_directions(reflectors, resolved, nv)
    inverse = pseudo_inverse_transposed(scaled, resolved)
    for i in range(resolved):
        sigma = abs(scaled[i, i])
        space.sigma[i] = sigma
        for c in range(nv):
            space.basis[i, c] = directions[c, i]
        for j in range(m):
            space.rows[i, order[j]] = inverse[i, j] * sigma / lengths[order[j]]
    return resolved


@inner
def _place_frames(tables: Tables, joint_poses: Array, poses: Array) -> None:
    """Fill the frames' poses in the world from those of their joints."""
    for frame in range(tables.carriers.size):
        joint = tables.carriers[frame]
        for column in range(0, 12, 3):
            x = tables.placements[frame, column]
            y = tables.placements[frame, column + 1]
            z = tables.placements[frame, column + 2]
            for i in range(3):
                turned = joint_poses[joint, i] * x
                turned += joint_poses[joint, 3 + i] * y
                turned += joint_poses[joint, 6 + i] * z
                poses[frame, column + i] = turned
        for i in range(3):
            poses[frame, 9 + i] += joint_poses[joint, 9 + i]


@inner
def _keep(scaled: Array, turn: Array, lengths: Array, tolerance: float, space: Packed) -> int:
    """Keep the directions that carry force, and return their number."""
    longest = np.sqrt(dot_rows(scaled, 0, 0))
    rank = 0
    for i in range(space.sigma.size):
        length = np.sqrt(dot_rows(scaled, i, i))
        if not length > RESOLVED * longest:
            break
        space.tail[2], space.tail[3] = length / longest, i + 1
        if not length > tolerance * longest:
            continue
        space.sigma[i] = length
        for c in range(scaled.shape[1]):
            space.basis[i, c] = scaled[i, c] / length
        for j in range(lengths.size):
            space.rows[i, j] = turn[i, j] / lengths[j]
        rank += 1
    return rank


@inner
def accelerate(
    space: Packed, rank: int, bias_force: Array, passive: Array, bias: Array, result: Array
) -> None:
    """Replace joint forces in ``result`` (nv + m,) by v̇, followed by λ."""
    nv, m = bias_force.size, bias.size
    rates, multipliers = result[:nv], result[nv:]
    multipliers[:] = 0.0
    for c in range(nv):
        rates[c] = rates[c] + passive[c] - bias_force[c]
    solve_lower(space.factor, rates)
    surplus = np.empty(rank)
    for i in range(rank):
        surplus[i] = dot_with_row(space.basis, i, rates)
        surplus[i] += dot_with_row(space.rows, i, bias) / space.sigma[i]
    for i in range(rank):
        for c in range(nv):
            rates[c] -= surplus[i] * space.basis[i, c]
        for j in range(m):
            multipliers[j] += space.rows[i, j] * (surplus[i] / space.sigma[i])
    solve_lower_transposed(space.factor, rates)


@inner
def correction_of(space: Packed, rank: int, residual: Array, change: Array) -> None:
    """Fill ``change`` (nv,) with D⁻¹Wᵀ(W D⁻¹Wᵀ)⁺ residual."""
    change[:] = 0.0
    for i in range(rank):
        along = dot_with_row(space.rows, i, residual) / space.sigma[i]
        for c in range(change.size):
            change[c] += along * space.basis[i, c]
    solve_lower_transposed(space.factor, change)


@inner
def close_rates(space: Packed, rank: int, rates: Array) -> None:
    """Replace rates v by v - D⁻¹Wᵀ(W D⁻¹Wᵀ)⁺ W v."""
    for i in range(rates.size):
        total = 0.0
        for k in range(i, rates.size):
            total += space.factor[k, i] * rates[k]
        rates[i] = total
    remove(space.basis, rank, rates)
    solve_lower_transposed(space.factor, rates)


@kernel(
    "int64(int64[::1], float64[::1], float64[:,::1], float64[:,::1], float64[:,::1], float64[::1])"
)
def factor_closures(
    numbers: Array,
    values: Array,
    inertia: Array,
    joint_jacobian: Array,
    joint_poses: Array,
    packed: Array,
) -> int:
    """Fill ``packed`` at a configuration.

    Args:
        numbers: constants of the mechanism, whole ones.
        values: the others; see ``tables.unfold``.
        inertia: (nv, nv) D, lower triangle.
        joint_jacobian: (nv, 6) world axes, at the world's origin.
        joint_poses: (joints, 12) each joint's axes in the world, then its origin.
        packed: to fill.

    Returns:
        The rank r; or NO_SVD, or SINGULAR and below.
    """
    tables = unfold(numbers, values)
    space = unpack(packed, tables.nv, tables.m)
    return factor(tables, inertia, joint_jacobian, joint_poses, space)


@kernel("void(float64[::1], int64, float64[::1], float64[::1], float64[::1], float64[::1])")
def solve_motion(
    packed: Array, rank: int, bias_force: Array, passive: Array, bias: Array, result: Array
) -> None:
    """Solve Eq. 1: see :func:`accelerate`."""
    space = unpack(packed, bias_force.size, bias.size)
    accelerate(space, rank, bias_force, passive, bias, result)


@kernel("void(float64[::1], int64, int64, int64, float64[::1], float64[::1])")
def correct(packed: Array, nv: int, m: int, rank: int, residual: Array, change: Array) -> None:
    """Fill ``change``: see :func:`correction_of`."""
    correction_of(unpack(packed, nv, m), rank, residual, change)


@kernel("void(float64[::1], int64, int64, int64, float64[::1])")
def keep_closed(packed: Array, nv: int, m: int, rank: int, rates: Array) -> None:
    """Replace rates: see :func:`close_rates`."""
    close_rates(unpack(packed, nv, m), rank, rates)
