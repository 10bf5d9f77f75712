# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Λ_h⁻¹ of an operational point at a state, and its analysis.

The constrained directions are chosen smoothly, for control:

    P_c = Σ w(s_i) n_i n_iᵀ / m_ℓ,       Π = Σ w(s_i) n_i n_iᵀ I_ℓ⁻¹

w falls smoothly from 1 at s_on to 0 at s_off, with continuous first and second derivative, so both
are continuous through changes of rank, independent of the sign and order of singular vectors. m_ℓ
is the metric's mass: a stiffness k multiplied by P_c is k N/m against pure translation of the link,
and the link's own mix of N/m and N m/rad in other directions.

The mass felt at an operational point in every direction.

A force f along an eigenvector of the translational block of X = Λ_h⁻¹ accelerates the point along
it by f/m: m is the mass felt, infinite where X has no response.

Spectrum of Λ_h⁻¹ in the link's metric: which directions are free and which are rigid.

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
from typing import NamedTuple

import numpy as np

from hapticmech_ros.numerics import Array

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


class CompensatedResponse(NamedTuple):
    """X_τ and a_τ, which replace X and a_0 in a loop with delay; world axes, at the point.

    Attributes:
        inverse_inertia: (6, 6) X_τ; 1/kg, 1/(kg m), 1/(kg m²).
        free_acceleration: (6,) a_τ, m/s² and rad/s².
    """

    inverse_inertia: Array
    free_acceleration: Array


@dataclass(frozen=True, slots=True)
class OperationalAnalysis:
    """Λ_h⁻¹ and its analysis; world axes, origin at the operational point, force first.

    Attributes:
        inverse_inertia: (6, 6) X; 1/kg, 1/(kg m), 1/(kg m²); zero in rows a planar scene lacks.
        spectrum: s, μ, rank and directions, on the task's rows only.
        weights: (t,) rigidity w(s_i), 0 to 1.
        constraint_projector: (6, 6) P_c, symmetric positive semi-definite, 1, m, m²; maps a twist
            error to a wrench shape.
        wrench_projector: (6, 6) Π, 1, m, 1/m: the part of a wrench that the joints balance.
        free_acceleration: (6,) a_0, acceleration of the point with no wrench on it; m/s², rad/s².
        rows: (t,) rows of a six-vector that the task space has.
    """

    inverse_inertia: Array
    spectrum: Spectrum
    weights: Array
    constraint_projector: Array
    wrench_projector: Array
    free_acceleration: Array
    rows: Array

    def __repr__(self) -> str:
        s = ", ".join(f"{value:.3g}" for value in self.spectrum.s)
        return f"OperationalAnalysis: rank {self.rank} of {self.spectrum.s.size}, s {s}"

    @property
    def rank(self) -> int:
        """Rank of X."""
        return self.spectrum.rank

    @property
    def constraint_wrenches(self) -> Array:
        """Return N_c (6, k), √kg and √kg m: wrenches that the joints balance entirely."""
        full = np.zeros((6, self.spectrum.s.size - self.rank))
        full[self.rows] = self.spectrum.constraint_wrenches
        return full


# Responses below this share of the largest one are rounding.
RIGID = 1e-9


def felt_masses(analysis: OperationalAnalysis) -> tuple[Array, Array]:
    """Return masses (k,), kg, infinite where rigid, lightest first, and their directions (3, k).

    k is 3, or 2 in the plane; torques are zero, and the point is free to turn.
    """
    rows = analysis.rows[analysis.rows < 3]
    response, vectors = np.linalg.eigh(analysis.inverse_inertia[np.ix_(rows, rows)])
    response, vectors = response[::-1], vectors[:, ::-1]
    masses = np.full(rows.size, np.inf)
    felt = response > RIGID * max(float(response[0]), 0.0)
    masses[felt] = 1.0 / response[felt]
    directions = np.zeros((3, rows.size))
    directions[rows] = vectors
    return masses, directions
