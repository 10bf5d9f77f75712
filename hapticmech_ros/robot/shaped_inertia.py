# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Λ⁺, the inverse of Λ_h⁻¹ that leaves out what is rigid, and the null space that fits it.

X = Λ_h⁻¹ = Σ μ_i d_i d_iᵀ with the pairs n_i, d_i = I_ℓ⁻¹ n_i of the spectrum, n_iᵀ d_j = δ_ij, so
its inverse is Σ n_i n_iᵀ / μ_i. With the weights w_i = w(s_i) by which joints count as rigid,

    Λ⁺ = Σ (1 - w_i) / μ_i n_i n_iᵀ                                                          (R1)

is that inverse, to rounding, where all s_i ≥ s_off; directions with s_i ≤ s_on have no part in it.
In between w falls smoothly, so Λ⁺ is as smooth as s. It asks for bounded torques in any pose:
L⁻¹ Jᵀ n_i has the length s_i, and s_i (1 - w_i) / μ_i ≤ 1 / s_on.

With the unit vectors of the mass metric u_i = L⁻¹ J_hᵀ n_i / s_i, D = L Lᵀ, torques of the null
space pass

    Nᵀ = L (1 - Σ (1 - k_i) u_i u_iᵀ) L⁻¹,      0 ≤ k_i ≤ w_i                                 (R2)

and accelerate the point by X-consistent parts only: n_iᵀ J D⁻¹ Nᵀ τ = k_i n_iᵀ J D⁻¹ τ, nothing
along directions that the law controls. Where all w_i = 0 it is 1 - Jᵀ Λ J D⁻¹. Derivation:
docs/robots.md.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from hapticmech_ros.arrays import Array
from hapticmech_ros.mechanism.lapack import dtrsm
from hapticmech_ros.operational import OperationalAnalysis
from hapticmech_ros.operational.spectrum import RANK_TOLERANCE


class ShapedInertia(NamedTuple):
    """Λ⁺ and what Nᵀ is made of, at a state; world axes at the operational point.

    Attributes:
        inverse: (6, 6) Λ⁺, kg, kg m and kg m²; zero in rows that the task does not have.
        units: (nv, t) columns u_i, in the spectrum's order; zero where s_i is rounding alone.
        free: (t,) 1 - w_i, likewise: 1 where the law decouples.
        joints: (nv, t) columns L⁻ᵀ u_i: joint rates of u̇_i = 1.
    """

    inverse: Array
    units: Array
    free: Array
    joints: Array

    def rates(self, most: float) -> Array:
        """Return the largest u̇_i (t,), √kg m/s, with joint rates |L⁻ᵀ u_i u̇_i| up to a limit.

        Args:
            most: rad/s or m/s.
        """
        moved = np.linalg.norm(self.joints, axis=0)
        # A direction that is not known moves nothing, whatever its rate is.
        return np.asarray(most / np.where(moved > 0.0, moved, 1.0))

    def null(self, motion: Array, passed: Array) -> Array:
        """Return L⁻¹ Nᵀ L m (nv,): what R2 leaves of a motion of joints in the mass metric.

        Args:
            motion: (nv,) m = L⁻¹ τ.
            passed: (t,) k_i.
        """
        return np.asarray(motion - self.units @ ((1.0 - passed) * (self.units.T @ motion)))


def shaped_inertia(analysis: OperationalAnalysis, jacobian: Array, factor: Array) -> ShapedInertia:
    """Return Λ⁺ (R1) and the directions of R2 of a tree without closures.

    Args:
        analysis: of the operational point at the state.
        jacobian: (6, nv) J_h there, m and 1.
        factor: (nv, nv) lower Cholesky factor L of D there.
    """
    rows, found = analysis.rows, analysis.spectrum
    # The weights' polynomial may exceed 1 by rounding just above s_on.
    free = np.maximum(1.0 - analysis.weights, 0.0)
    # Of directions with w = 1 s may be 0; they have no part in what is divided by it.
    safe = np.where(free > 0.0, found.s, 1.0)
    inverse = np.zeros((6, 6))
    inverse[np.ix_(rows, rows)] = (found.wrenches * (free / safe**2)) @ found.wrenches.T
    # L⁻¹ Jᵀ n_i = s_i u_i: (nv, t).
    long = dtrsm(1.0, factor, jacobian[rows].T @ found.wrenches, lower=1)
    known = found.s > RANK_TOLERANCE
    units = np.where(known, long / np.where(known, found.s, 1.0), 0.0)
    joints = dtrsm(1.0, factor, units, lower=1, trans_a=1)
    return ShapedInertia(inverse, units, free, joints)
