# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Lagrange's equations of a planar chain of revolute joints, closed form in absolute angles.

With theta_i the absolute angles, T = 1/2 sum a_ij cos(theta_i - theta_j) theta_i' theta_j', so
D = C^T A C and h = C^T (B theta'^2 + g), A_ij = a_ij cos(.), B_ij = a_ij sin(.), theta = C q.
"""

from __future__ import annotations

import numpy as np

Array = np.ndarray


def planar_chain(
    lengths: Array, masses: Array, centres: Array, inertias: Array, gravity_y: float
) -> tuple[Array, Array]:
    """Return coefficients a_ij (n, n) and weights w_i (n,) of the potential w_i sin(theta_i)."""
    n = len(lengths)
    reach = np.zeros((n, n))  # reach[k, i]: lever of theta_i in the centre of link k
    for k in range(n):
        reach[k, :k] = lengths[:k]
        reach[k, k] = centres[k]
    coefficients = np.einsum("k,ki,kj->ij", masses, reach, reach) + np.diag(inertias)
    return coefficients, -gravity_y * (masses @ reach)


def dynamics(coefficients: Array, weights: Array, q: Array, v: Array) -> tuple[Array, Array]:
    """Return D (n, n) and h (n,) in relative angles."""
    to_absolute = np.tril(np.ones((q.size, q.size)))
    angle, rate = to_absolute @ q, to_absolute @ v
    apart = angle[:, None] - angle[None, :]
    inertia = coefficients * np.cos(apart)
    bias = (coefficients * np.sin(apart)) @ rate**2 + weights * np.cos(angle)
    return to_absolute.T @ inertia @ to_absolute, to_absolute.T @ bias
