# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Dense textbook formulas: KKT solve, null-space X, ranks by scipy. Slow, and meant to be."""

from __future__ import annotations

import numpy as np
import scipy.linalg

Array = np.ndarray

# Rank decisions of the oracles: far above rounding (1e-15), far below the values of random scenes.
RCOND = 1e-9


def rank(matrix: Array) -> int:
    """Return the numerical rank, each row scaled to unit length first."""
    sizes = np.linalg.norm(matrix, axis=1)
    rows = matrix[sizes > 0.0] / sizes[sizes > 0.0, None]
    if not rows.size:
        return 0
    sigma = np.linalg.svd(rows, compute_uv=False)
    return int(np.count_nonzero(sigma > RCOND * sigma[0]))


def null_space(jacobian: Array, nv: int) -> Array:
    """Return N (nv, k), a basis of ker W."""
    if not jacobian.size:
        return np.eye(nv)
    return scipy.linalg.null_space(jacobian, rcond=RCOND)


def inverse_inertia(inertia: Array, closure_jacobian: Array, jacobian: Array) -> Array:
    """Return X = J N (N^T D N)^-1 N^T J^T, from independent coordinates of the closed loops."""
    basis = null_space(closure_jacobian, inertia.shape[0])
    reduced = basis.T @ inertia @ basis
    return jacobian @ basis @ np.linalg.solve(reduced, basis.T @ jacobian.T)


def kkt(inertia: Array, rows: Array, force: Array, rate_bias: Array) -> tuple[Array, Array]:
    """Return v' and the smallest multipliers of D v' + W^T lambda = force, W v' = -rate_bias."""
    nv, m = inertia.shape[0], rows.shape[0]
    matrix = np.block([[inertia, rows.T], [rows, np.zeros((m, m))]])
    solution = np.linalg.lstsq(matrix, np.concatenate((force, -rate_bias)), rcond=1e-12)[0]
    return solution[:nv], solution[nv:]


def truncated(factor: Array, rows: Array, kept: int) -> tuple[Array, Array, Array]:
    """Return U (nv, r), W's leading directions in D's metric, (W L⁻ᵀ)⁺ of them, and all σ.

    Args:
        factor: (nv, nv) L of D = L Lᵀ.
        rows: (m, nv) W, of which so many directions are ``kept``.
    """
    lifted = scipy.linalg.solve_triangular(factor, rows.T, lower=True)
    left, sigma, right = np.linalg.svd(lifted, full_matrices=False)
    directions = left[:, :kept]
    return directions, (directions / sigma[:kept]) @ right[:kept], sigma
