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

What joints do along directions in which their point is rigid: a limited rate, and coasting.

Along u_i = L⁻¹ Jᵀ n_i / s_i, a unit vector of the mass metric, joints move with the rate
u̇_i = u_iᵀ Lᵀ v, and the point with n_iᵀ ẋ = s_i u̇_i. Where s_i is small joints cannot have the
acceleration that the point is asked for. They are given a rate that they can have:

    p   = ẋ_d + ω e / 2                                     the twist that is asked of the point
    u_i' = σ(s_i n_iᵀ p / (s_i² + ε_i²)),      ε_i² = |n_iᵀ e · n_iᵀ J̇(w_i) w_i|              (R7)
    y_i = w_i (ω b_i (u_i' - u̇_i) + σ_a(s_i n_iᵀ (ẍ_d - J̇ v) / (s_i² + ε_i² + λ²)))
    b_i = (s_i² + ε_i²) / (s_i² + ε_i² + λ²),       λ = s_on / 10

With the joint motion w_i = L⁻ᵀ u_i, n_iᵀ x changes by s_i u + n_iᵀ J̇(w_i) w_i u² / 2 over a way
u, so that s_i² ± ε_i² is the second derivative of (n_iᵀ e)² / 2: u_i' is a step of Newton's method
with the sign that lets it go downhill. It is exact for a motion that the robot can make, whatever
s_i is, and pulls less where the point is at the end of what it can reach. Errors along other
directions say nothing about u_i, and do not damp it.
The smooth saturations σ keep it within a rate of the joints, and σ_a within what changes that in
1/ω. Next to the singular pose itself, s_i < λ, where a target that is reached says nothing about
u̇_i, joints coast: they are neither driven nor braked. Derivation: docs/robots.md.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from hapticmech_ros.arrays import Array
from hapticmech_ros.mechanism.lapack import dtrsm
from hapticmech_ros.operational import OperationalAnalysis
from hapticmech_ros.operational.results import RANK_TOLERANCE
from hapticmech_ros.robot.gains import Gains


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


# λ / s_on.
COASTING = 0.1


class RigidDirections:
    """The part of the law along rigid directions at a state (R7).

    Args:
        analysis: of the operational point.
        shaped: directions there.
        gains: of the law.
        s_on: where directions become rigid.
        error: (6,) e, m and rad.
        bend: returns J̇(w) w (6,), m/s² and rad/s², for joint rates w (nv,).
    """

    def __init__(
        self,
        analysis: OperationalAnalysis,
        shaped: ShapedInertia,
        gains: Gains,
        s_on: float,
        error: Array,
        bend: Callable[[Array], Array],
    ) -> None:
        found, rows = analysis.spectrum, analysis.rows
        self._rows, self._wrenches, self._s = rows, found.wrenches, found.s
        self._units, self._rigid = shaped.units, 1.0 - shaped.free
        rates = np.repeat((gains.linear_rate, gains.angular_rate), 3)[rows]
        own = np.sum(found.wrenches * found.duals * rates[:, None], axis=0)
        self._own_rates = np.maximum(own, 0.0)
        self._most = shaped.rates(gains.joint_rate)
        self._error = np.zeros_like(found.s)
        for at in np.flatnonzero(self._rigid):
            n = found.wrenches[:, at]
            bent = float(n @ bend(shaped.joints[:, at])[rows])
            self._error[at] = abs(float(n @ error[rows]) * bent)
        self._damped = found.s**2 + self._error + (COASTING * s_on) ** 2

    @property
    def passed(self) -> Array:
        """Shares (t,) w_i ε_i² / (s_i² + ε_i² + λ²) of torques of the null space along u_i."""
        return np.asarray(self._rigid * self._error / self._damped)

    def acceleration(self, speed: Array, twist: Array, ahead: Array) -> Array:
        """Return Σ y_i u_i (nv,), by the factor Lᵀ times joint accelerations.

        Args:
            speed: (nv,) Lᵀ v.
            twist: (6,) p, m/s and rad/s, world axes at the point.
            ahead: (6,) ẍ_d - J̇ v, m/s² and rad/s², likewise.
        """
        n, s = self._wrenches.T, self._s
        undamped = s**2 + self._error
        wanted = s * (n @ twist[self._rows])
        # As σ(wanted / undamped), which may be 0 / 0 in the singular pose.
        size = np.maximum(np.hypot(self._most * undamped, wanted), np.finfo(float).tiny)
        limited = self._most * wanted / size
        braked = undamped / self._damped
        driven = s * (n @ ahead[self._rows]) / self._damped
        most = np.maximum(self._most * self._own_rates, np.finfo(float).tiny)
        driven = driven / np.hypot(1.0, driven / most)
        towards = self._own_rates * braked * (limited - self._units.T @ speed)
        return np.asarray(self._units @ (self._rigid * (towards + driven)))
