"""Kernel of the analysis at an operational point: X, its spectrum, P_c, Π and a_0."""

from __future__ import annotations

import numpy as np

from hapticmech_ros.compilation import kernel
from hapticmech_ros.mechanism.kernels import accelerate, unpack
from hapticmech_ros.mechanism.model import Array
from hapticmech_ros.mechanism.small_matrices import dot, orthogonalise, remove, solve_lower


@kernel(
    "boolean(float64[::1], int64, float64[::1], float64[::1], float64[::1], float64[:,::1],"
    " float64[::1], float64[::1,:], float64[:,:,::1], float64[:,::1], float64, float64, float64,"
    " int64[::1], float64[:,:,::1], float64[:,::1], float64[:,:,::1], float64[::1])"
)
def analyse_point(
    packed: Array,
    rank: int,
    bias_force: Array,
    passive: Array,
    bias: Array,
    jacobian: Array,
    drift: Array,
    rotation: Array,
    factors: Array,
    point_to_link: Array,
    mass: float,
    s_on: float,
    s_off: float,
    rows: Array,
    squares: Array,
    values: Array,
    directions: Array,
    acceleration: Array,
) -> bool:
    """Analyse one operational point.

    Args:
        packed: space of the closures (see mechanism.kernels).
        rank: its rank r.
        bias_force: (nv,) h.
        passive: (nv,) joint damping.
        bias: (m,) Ẇv.
        jacobian: (6, nv) J_h.
        drift: (6,) J̇_h v.
        rotation: (3, 3) of the point.
        factors: (2, t, t) G and G⁻ᵀ in the axes of the link.
        point_to_link: (3, 3) rotation.
        mass: reference mass of the metric, kg.
        s_on: rigid up to here.
        s_off: free from here.
        rows: (t,) rows of a six-vector that the task space has.
        squares: (3, 6, 6) zeros, to fill with X, P_c, Π.
        values: (2, t) to fill with s and weights.
        directions: (2, t, t) to fill with the columns n_i and I_ℓ⁻¹ n_i.
        acceleration: (6,) to fill with a_0.

    Returns:
        Whether the SVD converged.
    """
    nv, m, t = bias_force.size, bias.size, rows.size
    factor, _, _, basis, _, _ = unpack(packed, nv, m)
    free = np.zeros(nv + m)
    accelerate(packed, rank, bias_force, passive, bias, free)
    for i in range(6):
        acceleration[i] = dot(jacobian[i], free[:nv]) + drift[i]
    # Rows are the columns of S.
    root = np.empty((t, nv))
    for i in range(t):
        root[i] = jacobian[rows[i]]
        solve_lower(factor, root[i])
        remove(basis[:rank], root[i])
    for i in range(t):
        for j in range(i + 1):
            product = dot(root[i], root[j])
            squares[0, rows[i], rows[j]] = product
            squares[0, rows[j], rows[i]] = product
    metric = np.zeros((2, t, t))
    turn = np.zeros((t, t))
    block = 3 if t == 6 else 2
    turn[t - 1, t - 1] = 1.0
    for i in range(block):
        for j in range(block):
            total = 0.0
            for k in range(3):
                total += rotation[i, k] * point_to_link[k, j]
            turn[i, j] = total
            if t == 6:
                turn[3 + i, 3 + j] = total
    for which in range(2):
        for i in range(t):
            for k in range(t):
                for j in range(t):
                    metric[which, i, j] += turn[i, k] * factors[which, k, j]
    measured = np.zeros((t, nv))
    for j in range(t):
        for i in range(t):
            for c in range(nv):
                measured[j, c] += metric[0, i, j] * root[i, c]
    if not orthogonalise(measured, turn):
        return False
    for i in range(t):
        s = np.sqrt(dot(measured[i], measured[i])) if i < nv else 0.0
        x = min(max((s_off - s) / (s_off - s_on), 0.0), 1.0)
        values[0, i] = s
        values[1, i] = x * x * x * (10.0 - 15.0 * x + 6.0 * x * x)
        for which in range(2):
            for j in range(t):
                directions[which, j, i] = dot(metric[which, j], turn[i])
    for i in range(t):
        for j in range(t):
            projected, balanced = 0.0, 0.0
            for k in range(t):
                weighted = directions[0, i, k] * values[1, k]
                projected += weighted * directions[0, j, k]
                balanced += weighted * directions[1, j, k]
            squares[1, rows[i], rows[j]] = projected / mass
            squares[2, rows[i], rows[j]] = balanced
    return True
