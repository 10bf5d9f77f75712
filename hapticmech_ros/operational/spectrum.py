# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Spectrum of Λ_h⁻¹ in the link's metric: which directions are free and which are rigid.

X = Λ_h⁻¹ = SᵀS is the dynamically consistent inverse inertia at an operational point, and

    S = (1 - U Uᵀ) L⁻¹ J_hᵀ      with D = L Lᵀ and U an orthonormal basis of range(L⁻¹Wᵀ)

is what is factored further: its singular values are square roots of the eigenvalues of X, so a
direction that X loses at 1e-8 of its largest eigenvalue is still resolved in S at 1e-16. Units of X
are 1/kg for force-force, 1/(kg m) mixed, 1/(kg m²) for torque-torque.

With I_ℓ = G Gᵀ the SVD  S G = Q diag(s) Vᵀ  gives s_i = sqrt(μ_i) in [0, 1] and the wrenches
n_i = G v_i, normalised so that n_iᵀ I_ℓ⁻¹ n_j = δ_ij. X n_i = s_i² I_ℓ⁻¹ n_i: where s_i = 0 the
joints balance n_i entirely.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hapticmech_ros.arrays import Array

# Singular values of S G are exact to a few machine epsilons; below this nothing is carried.
RANK_TOLERANCE = 1e-10


@dataclass(frozen=True, slots=True)
class Spectrum:
    """Singular values and directions of S in the metric.

    Attributes:
        s: (t,) sqrt(μ), descending; t is 6, or 3 in the plane.
        wrenches: (t, t) columns n_i, √kg and √kg m, world axes at the operational point.
        duals: (t, t) columns I_ℓ⁻¹ n_i, 1/√kg and 1/(√kg m); dualsᵀ wrenches = 1.
    """

    s: Array
    wrenches: Array
    duals: Array

    @property
    def mu(self) -> Array:
        """Return (t,) μ = s²: 0 rigid, 1 as free as the link alone."""
        return self.s**2

    @property
    def rank(self) -> int:
        """Numerical rank of X, decided on s."""
        return rank_of(self.s)

    @property
    def constraint_wrenches(self) -> Array:
        """Return N_c (t, k), √kg and √kg m: a basis of ker X, on the task's rows."""
        return self.wrenches[:, self.rank :]


def rank_of(s: Array) -> int:
    """Return the numerical rank of X: how many s are above 1e-10.

    Args:
        s: (t,) singular values, descending.
    """
    return int(np.count_nonzero(s > RANK_TOLERANCE))
