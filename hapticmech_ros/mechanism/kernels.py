"""Kernels of Eq. 1: factorisation of D and W, accelerations, projections.

What :class:`~hapticmech_ros.mechanism.constraint_space.ConstraintSpace` holds is packed into one
array: L (nv, nv), φ (m,), W (m, nv), Uᵀ (k, nv), σ (k,), rowsᵀ (k, m), max |φ|. There is room for
k = min(m, nv) directions, of which the first r (rank) are filled.
"""

from __future__ import annotations

import numpy as np

from hapticmech_ros.compilation import inner, kernel
from hapticmech_ros.mechanism.closure_kernels import jacobian_of, residual_of
from hapticmech_ros.mechanism.constraint_space import (
    DRIFT_CAP,
    DRIFT_FACTOR,
    SOLVER_RANK_TOLERANCE,
)
from hapticmech_ros.mechanism.model import Array
from hapticmech_ros.mechanism.small_matrices import (
    cholesky,
    dot,
    orthogonalise,
    remove,
    solve_lower,
    solve_lower_transposed,
)


@inner
def unpack(packed: Array, nv: int, m: int) -> tuple[Array, Array, Array, Array, Array, Array]:
    """Return views of L, φ, W, Uᵀ, σ, rowsᵀ in a packed space."""
    k = min(m, nv)
    at = nv * nv
    factor = packed[:at].reshape(nv, nv)
    residual = packed[at : at + m]
    at += m
    jacobian = packed[at : at + m * nv].reshape(m, nv)
    at += m * nv
    basis = packed[at : at + k * nv].reshape(k, nv)
    at += k * nv
    sigma = packed[at : at + k]
    at += k
    return factor, residual, jacobian, basis, sigma, packed[at : at + k * m].reshape(k, m)


@kernel(
    "int64(float64[:,::1], float64[:,::1], float64[:,::1], float64[:,::1], int64[:,::1],"
    " float64[::1], float64[::1])"
)
def factor_closures(
    inertia: Array,
    joint_jacobian: Array,
    poses: Array,
    support: Array,
    closures: Array,
    lengths: Array,
    packed: Array,
) -> int:
    """Fill ``packed`` at a configuration.

    Args:
        inertia: (nv, nv) D, lower triangle.
        joint_jacobian: (nv, 6) world axes, at the world's origin.
        poses: (frames, 12).
        support: (frames, nv) 1 where a rate moves a frame, else 0.
        closures: per active closure its kind, its frames a and b, and its first row.
        lengths: (m,) unit of each row.
        packed: to fill.

    Returns:
        The rank r; -1 where the SVD fails; -2 - i where D is not positive definite at rate i.
    """
    nv, m = inertia.shape[0], lengths.size
    factor, residual, jacobian, basis, sigma, rows = unpack(packed, nv, m)
    bad = cholesky(inertia, factor)
    if bad >= 0:
        return -2 - bad
    packed[-1] = 0.0
    if m == 0:
        return 0
    for index in range(closures.shape[0]):
        kind, a, b, first = closures[index]
        residual_of(kind, poses[a], poses[b], residual[first:])
        on_a, on_b = support[a], support[b]
        jacobian_of(kind, poses[a], poses[b], on_a, on_b, joint_jacobian, jacobian[first:])
    scaled, turn = np.empty((m, nv)), np.empty((m, m))
    drift = 0.0
    for i in range(m):
        packed[-1] = max(packed[-1], abs(residual[i]))
        drift = max(drift, abs(residual[i] / lengths[i]))
        for c in range(nv):
            scaled[i, c] = jacobian[i, c] / lengths[i]
        solve_lower(factor, scaled[i])
    if not orthogonalise(scaled, turn):
        return -1
    tolerance = max(SOLVER_RANK_TOLERANCE, min(DRIFT_FACTOR * drift, DRIFT_CAP))
    longest = np.sqrt(dot(scaled[0], scaled[0]))
    rank = 0
    for i in range(min(m, nv)):
        length = np.sqrt(dot(scaled[i], scaled[i]))
        if not length > tolerance * longest:
            break
        sigma[i] = length
        for c in range(nv):
            basis[i, c] = scaled[i, c] / length
        for j in range(m):
            rows[i, j] = turn[i, j] / lengths[j]
        rank += 1
    return rank


@inner
def accelerate(
    packed: Array, rank: int, bias_force: Array, passive: Array, bias: Array, result: Array
) -> None:
    """Replace joint forces in ``result`` (nv + m,) by v̇, followed by λ."""
    nv, m = bias_force.size, bias.size
    factor, _, _, basis, sigma, rows = unpack(packed, nv, m)
    rates, multipliers = result[:nv], result[nv:]
    multipliers[:] = 0.0
    for c in range(nv):
        rates[c] = rates[c] + passive[c] - bias_force[c]
    solve_lower(factor, rates)
    surplus = np.empty(rank)
    for i in range(rank):
        surplus[i] = dot(basis[i], rates) + dot(rows[i], bias) / sigma[i]
    for i in range(rank):
        for c in range(nv):
            rates[c] -= surplus[i] * basis[i, c]
        for j in range(m):
            multipliers[j] += rows[i, j] * (surplus[i] / sigma[i])
    solve_lower_transposed(factor, rates)


@kernel("void(float64[::1], int64, float64[::1], float64[::1], float64[::1], float64[::1])")
def solve_motion(
    packed: Array, rank: int, bias_force: Array, passive: Array, bias: Array, result: Array
) -> None:
    """Solve Eq. 1: see :func:`accelerate`."""
    accelerate(packed, rank, bias_force, passive, bias, result)


@kernel("void(float64[::1], int64, int64, int64, float64[::1], float64[::1])")
def correct(packed: Array, nv: int, m: int, rank: int, residual: Array, change: Array) -> None:
    """Fill ``change`` (nv,) with D⁻¹Wᵀ(W D⁻¹Wᵀ)⁺ residual."""
    factor, _, _, basis, sigma, rows = unpack(packed, nv, m)
    change[:] = 0.0
    for i in range(rank):
        along = dot(rows[i], residual) / sigma[i]
        for c in range(nv):
            change[c] += along * basis[i, c]
    solve_lower_transposed(factor, change)


@kernel("void(float64[::1], int64, int64, int64, float64[::1])")
def keep_closed(packed: Array, nv: int, m: int, rank: int, rates: Array) -> None:
    """Replace rates v by v - D⁻¹Wᵀ(W D⁻¹Wᵀ)⁺ W v."""
    factor, _, _, basis, _, _ = unpack(packed, nv, m)
    for i in range(nv):
        total = 0.0
        for k in range(i, nv):
            total += factor[k, i] * rates[k]
        rates[i] = total
    remove(basis[:rank], rates)
    solve_lower_transposed(factor, rates)
