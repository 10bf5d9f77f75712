# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""X = Λ_h⁻¹ = SᵀS, the dynamically consistent inverse inertia at a point, and the spectrum of S.

S = (1 - U Uᵀ) L⁻¹ J_hᵀ      with D = L Lᵀ and U an orthonormal basis of range(L⁻¹Wᵀ)
"""

from __future__ import annotations

from typing import Protocol

import numpy as np
from scipy.linalg import lapack

from hapticmech_ros.arrays import Array
from hapticmech_ros.errors import HapticMechError
from hapticmech_ros.operational.analysis import TaskMetric
from hapticmech_ros.operational.results import Spectrum


class Space(Protocol):
    """Factorisation of D and W, of kernels or of NumPy."""

    def to_mass_metric(self, force: Array) -> Array:
        """Return L⁻¹ f."""

    def without_closure_part(self, columns: Array) -> Array:
        """Return (1 - U Uᵀ) x."""


def root(space: Space, jacobian: Array) -> Array:
    """Return S (nv, t) for a task Jacobian J_h (t, nv); X = SᵀS.

    Units of SᵀS: 1/kg for force-force, 1/(kg m) mixed, 1/(kg m²) for torque-torque.
    """
    return space.without_closure_part(space.to_mass_metric(jacobian.T))


def inverse_inertia(root_matrix: Array) -> Array:
    """Return X (t, t) = SᵀS, symmetric positive semi-definite to the last bit of symmetry."""
    return np.asarray(root_matrix.T @ root_matrix)


def embed(task_matrix: Array, rows: Array) -> Array:
    """Return the (6, 6) matrix that has ``task_matrix`` in the task's rows and zero elsewhere."""
    full = np.zeros((6, 6))
    full[np.ix_(rows, rows)] = task_matrix
    return full


def factors_in_world(metric: TaskMetric, rotation: Array) -> tuple[Array, Array]:
    """Return G (t, t) with I_ℓ = G Gᵀ, and G⁻ᵀ, on the task's rows and in world axes.

    Args:
        metric: of the point.
        rotation: (3, 3) orientation of the operational point.
    """
    link = rotation @ metric.point_to_link
    turn = np.kron(np.eye(2), link)[np.ix_(metric.rows, metric.rows)]
    return turn @ metric.factor, turn @ metric.dual_factor


def spectrum(root_matrix: Array, metric_factor: Array, dual_factor: Array) -> Spectrum:
    """Return the spectrum of S (nv, t) in the metric I_ℓ = G Gᵀ.

    Args:
        root_matrix: (nv, t) S.
        metric_factor: (t, t) G.
        dual_factor: (t, t) G⁻ᵀ.
    """
    size = metric_factor.shape[0]
    _, values, right, info = lapack.dgesdd(root_matrix @ metric_factor, full_matrices=1)
    if info != 0:
        raise HapticMechError(f"SVD of S did not converge (LAPACK info {info})")
    s = np.zeros(size)
    s[: values.size] = values[:size]
    vectors = right.T
    return Spectrum(s, metric_factor @ vectors, dual_factor @ vectors)
