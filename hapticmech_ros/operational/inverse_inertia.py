"""X = Λ_h⁻¹ = SᵀS, the dynamically consistent inverse inertia at an operational point.

    S = (1 - U Uᵀ) L⁻¹ J_hᵀ      with D = L Lᵀ and U an orthonormal basis of range(L⁻¹Wᵀ)

S is what is factored further: its singular values are square roots of the eigenvalues of X, so a
direction that X loses at 1e-8 of its largest eigenvalue is still resolved in S at 1e-16.
"""

from __future__ import annotations

import numpy as np

from hapticmech_ros.arrays import Array
from hapticmech_ros.mechanism.constraint_space import ConstraintSpace

# Rows of a task wrench or twist (force first) that a planar scene has: x, y and rotation about z.
PLANAR_ROWS = np.array([0, 1, 5])
SPATIAL_ROWS = np.arange(6)


def root(space: ConstraintSpace, jacobian: Array) -> Array:
    """Return S (nv, t) for a task Jacobian J_h (t, nv); X = SᵀS.

    Units of SᵀS: 1/kg for force-force, 1/(kg m) mixed, 1/(kg m²) for torque-torque.
    """
    return space.without_closure_part(space.to_mass_metric(jacobian.T))


def inverse_inertia(root_matrix: Array) -> Array:
    """Return X (t, t) = SᵀS, symmetric positive semi-definite to the last bit of symmetry."""
    return np.asarray(root_matrix.T @ root_matrix)


_PLANAR_BLOCK = np.ix_(PLANAR_ROWS, PLANAR_ROWS)


def embed(task_matrix: Array) -> Array:
    """Return the (6, 6) matrix that has ``task_matrix`` in the task's rows and zero elsewhere."""
    if task_matrix.shape[0] == SPATIAL_ROWS.size:
        return task_matrix
    full = np.zeros((6, 6))
    full[_PLANAR_BLOCK] = task_matrix
    return full


def planar_block(matrix: Array) -> Array:
    """Return the (3, 3) part of a (6, 6) matrix that a planar scene has."""
    return np.asarray(matrix[_PLANAR_BLOCK])
