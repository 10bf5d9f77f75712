# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What joints do along directions in which their point is rigid: a limited rate, and coasting.

Along u_i = L⁻¹ Jᵀ n_i / s_i, a unit vector of the mass metric, joints move with the rate
u̇_i = u_iᵀ Lᵀ v, and the point with n_iᵀ ẋ = s_i u̇_i. Where s_i is small joints cannot have the
acceleration that the point is asked for. They are given a rate that they can have:

    p   = ẋ_d + ω e / 2                                     the twist that is asked of the point
    u_i' = σ(s_i n_iᵀ p / (s_i² + ε²)),      ε = s_off |e| / e_s                              (R7)
    y_i = w_i (ω b_i (u_i' - u̇_i) + σ_a(s_i n_iᵀ (ẍ_d - J̇ v) / (s_i² + ε² + λ²)))
    b_i = (s_i² + ε²) / (s_i² + ε² + λ²),       λ = s_on / 10

u_i' is the least-squares solution whose damping is the point's error (S. K. Chan and P. D.
Lawrence, IEEE ICRA 1988; T. Sugihara, IEEE T-RO 27(5), 2011): exact for a motion that the robot can
make, whatever s_i is, and without a pull where the point is at the end of what it can reach. The
smooth saturations σ keep it within a rate of the joints, and σ_a within what changes that in 1/ω.
Next to the singular pose itself, s_i < λ, where a target that is reached says nothing about u̇_i,
joints coast: they are neither driven nor braked. What has an error there is braked, for ε > 0.
|e| is its length in the metric, √(eᵀ I_ℓ e / m_ℓ): m. Derivation: docs/robots.md.
"""

from __future__ import annotations

import numpy as np

from hapticmech_ros.arrays import Array
from hapticmech_ros.mechanism.lapack import dtrsm
from hapticmech_ros.operational import OperationalAnalysis
from hapticmech_ros.robot.gains import Gains
from hapticmech_ros.robot.shaped_inertia import ShapedInertia

# λ / s_on.
COASTING = 0.1


class RigidDirections:
    """The part of the law along rigid directions at a state (R7).

    Args:
        analysis: of the operational point.
        shaped: directions there.
        factor: (nv, nv) lower Cholesky factor L of D.
        gains: of the law.
        s_on: where directions become rigid.
        s_off: where they become free.
        mass: m_ℓ of the metric, kg.
        error: (6,) e, m and rad.
    """

    def __init__(
        self,
        analysis: OperationalAnalysis,
        shaped: ShapedInertia,
        factor: Array,
        gains: Gains,
        s_on: float,
        s_off: float,
        mass: float,
        error: Array,
    ) -> None:
        found = analysis.spectrum
        self._rows, self._wrenches, self._s = analysis.rows, found.wrenches, found.s
        self._units, self._rigid, self._gains = shaped.units, 1.0 - shaped.free, gains
        self._rates = np.repeat((gains.linear_rate, gains.angular_rate), 3)[analysis.rows]
        length = float(np.linalg.norm(found.wrenches.T @ error[analysis.rows])) / np.sqrt(mass)
        self._error = (s_off * length / gains.rigid_error) ** 2
        self._damped = found.s**2 + self._error + (COASTING * s_on) ** 2
        own = np.sum(found.wrenches * found.duals * self._rates[:, None], axis=0)
        self._own_rates = np.maximum(own, 0.0)
        joints = dtrsm(1.0, factor, shaped.units, lower=1, trans_a=1)
        moved = np.linalg.norm(joints, axis=0)
        # A direction that is not known moves nothing, whatever its rate is.
        self._most = gains.rigid_joint_rate / np.where(moved > 0.0, moved, 1.0)

    @property
    def passed(self) -> Array:
        """Shares (t,) w_i ε² / (s_i² + ε² + λ²) of the null space's torques that act along u_i."""
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
