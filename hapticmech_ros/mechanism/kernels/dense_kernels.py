"""W of all closures, dense, and its factorisation with that of D: SVD, or QR of many rows."""

from __future__ import annotations

import numpy as np

from hapticmech_ros.arrays import Array
from hapticmech_ros.compilation import inner, local_whole
from hapticmech_ros.mechanism.kernels.band_kernels import NOT_DECIDED
from hapticmech_ros.mechanism.kernels.closure_kernels import COUPLING, end_of_rows
from hapticmech_ros.mechanism.kernels.coupling_kernels import add_gear
from hapticmech_ros.mechanism.kernels.data import Data
from hapticmech_ros.mechanism.kernels.many_rows import (
    FEW_ROWS,
    first_directions,
    pseudo_inverse_transposed,
    solve_lower_columns,
    triangularise,
)
from hapticmech_ros.mechanism.kernels.model import Model
from hapticmech_ros.mechanism.kernels.pair_kernels import add_pair
from hapticmech_ros.mechanism.kernels.small_matrices import dot_rows, orthogonalise, solve_lower
from hapticmech_ros.mechanism.kernels.step_layout import LEAST, RESOLVED_RANK
from hapticmech_ros.mechanism.tolerances import RESOLVED

# What a kernel returns where an SVD does not converge.
NO_SVD = -1


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
            add_gear(model, a, b, jacobian[first])
    rank = NOT_DECIDED
    if m > FEW_ROWS:
        rank = _resolve_many(model, tolerance, data)
    if rank == NOT_DECIDED:
        rank = _resolve_few(model, tolerance, data)
    return rank


@inner
def _resolve_few(model: Model, tolerance: float, data: Data) -> int:
    """Fill basis, σ and rows by an SVD; return the rank, or NO_SVD."""
    jacobian, factor, units = data.jacobian, data.factor, model.units
    m, nv = jacobian.shape
    scaled, turn = model.scaled, model.turn
    for i in range(m):
        for c in range(nv):
            scaled[i, c] = jacobian[i, c] / units[i]
        solve_lower(factor, scaled[i])
    if not orthogonalise(scaled, turn):
        return NO_SVD
    return _keep(scaled, turn, units, tolerance, data)


@inner
def _resolve_many(model: Model, tolerance: float, data: Data) -> int:
    """Fill basis and rows as an SVD does, but for a rotation of both; σ are R's diagonal.

    Return the rank; NO_SVD; or NOT_DECIDED where more than rounding has to be cut, off the
    closures or next to a singular position: only an SVD cuts no more than needs be.
    """
    jacobian, basis, rows, sigmas = data.jacobian, data.basis, data.rows, data.sigma
    m, nv = jacobian.shape
    most, units, sums = sigmas.size, model.units, model.sums
    scaled, directions, inverse = model.columns, model.directions, model.inverse
    for c in range(nv):
        for i in range(m):
            scaled[c, i] = jacobian[i, c] / units[i]
            if not np.isfinite(scaled[c, i]):
                return NO_SVD
    solve_lower_columns(data.factor, scaled)
    order, reflectors = local_whole(m), model.reflectors
    resolved = triangularise(scaled, most, RESOLVED, order, reflectors, sums)
    if resolved > 0 and not abs(scaled[resolved - 1, resolved - 1]) > tolerance * abs(scaled[0, 0]):
        return NOT_DECIDED
    if resolved > 0:
        data.tail[LEAST] = abs(scaled[resolved - 1, resolved - 1] / scaled[0, 0])
    data.tail[RESOLVED_RANK] = resolved
    first_directions(reflectors, resolved, nv, sums[0], directions)
    pseudo_inverse_transposed(scaled, resolved, model.inverting, sums, inverse)
    for i in range(resolved):
        sigma = abs(scaled[i, i])
        sigmas[i] = sigma
        for c in range(nv):
            basis[i, c] = directions[c, i]
        for j in range(m):
            rows[i, order[j]] = inverse[i, j] * sigma / units[order[j]]
    return resolved


@inner
def _keep(scaled: Array, turn: Array, units: Array, tolerance: float, data: Data) -> int:
    """Keep the directions that carry force, and return their number."""
    longest = np.sqrt(dot_rows(scaled, 0, 0))
    rank, sigma, basis, rows, tail = 0, data.sigma, data.basis, data.rows, data.tail
    for i in range(sigma.size):
        length = np.sqrt(dot_rows(scaled, i, i))
        if not length > RESOLVED * longest:
            break
        tail[LEAST], tail[RESOLVED_RANK] = length / longest, i + 1
        if not length > tolerance * longest:
            continue
        sigma[i] = length
        for c in range(scaled.shape[1]):
            basis[i, c] = scaled[i, c] / length
        for j in range(units.size):
            rows[i, j] = turn[i, j] / units[j]
        rank += 1
    return rank
