# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Terms of Eq. 1 of a mechanism, at a configuration and at a state."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pinocchio as pin

from hapticmech_ros.arrays import Array
from hapticmech_ros.mechanism.constraint_space import Closing, ConstraintSpace
from hapticmech_ros.mechanism.kernels.factor_kernels import solve_motion


class PointKinematics(NamedTuple):
    """An operational point at a state, axes of the world, origin at the point.

    Attributes:
        pose: point frame in the world.
        jacobian: (6, nv) J_h, m and 1, linear rows first.
        twist: (6,) J_h v, m/s and rad/s.
        drift: (6,) J̇_h v, acceleration of the point at v̇ = 0, m/s² and rad/s².
    """

    pose: pin.SE3
    jacobian: Array
    twist: Array
    drift: Array


class Evaluation(NamedTuple):
    """All terms of Eq. 1 at one state.

    Attributes:
        bias_force: (nv,) h, Coriolis, centripetal and gravity terms, N m or N.
        passive_force: (nv,) springs, dampers, friction and stops, N m or N.
        dissipative_force: (nv,) the part of these that only takes energy.
        effort: (nv,) constant forces of the joints, N m or N.
        closure_bias: (m,) Ẇv, m/s² and 1/s².
        closing: φ, W and their factorisation.
        points: operational points in the scene's order.
        v: (nv,) rates at which they were evaluated, rad/s or m/s.
    """

    bias_force: Array
    passive_force: Array
    dissipative_force: Array
    effort: Array
    closure_bias: Array
    closing: Closing
    points: tuple[PointKinematics, ...]
    v: Array

    @property
    def closure_residual(self) -> Array:
        """(m,) φ of the active closures, m and rad."""
        return self.closing.residual

    @property
    def closure_jacobian(self) -> Array:
        """(m, nv) W of the active closures, m and 1."""
        return self.closing.jacobian

    @property
    def space(self) -> ConstraintSpace:
        """Factorisation of D and W."""
        return self.closing.space

    @property
    def inertia(self) -> Array:
        """Return D (nv, nv) = L Lᵀ, symmetric; kg, kg m and kg m², joint coordinates."""
        factor = self.space.factor
        return np.asarray(factor @ factor.T)

    def acceleration(self, joint_force: Array) -> tuple[Array, Array]:
        """Solve Eq. 1 for joint forces Σ Jᵀ F, on top of passive forces and efforts.

        Args:
            joint_force: (nv,) N m or N.

        Returns:
            v̇ (nv,), rad/s² or m/s², and closure forces λ (m,), N and N m, on frames b; the
            smallest ones where closures are redundant.
        """
        # λ is the smallest one only in the dense factorisation.
        dense, nv, bias = self.closing.dense, self.bias_force.size, self.closure_bias
        result = np.empty(nv + bias.size)
        np.add(joint_force, self.effort, out=result[:nv])
        solve_motion(
            *dense.active_set.constants,
            dense.packed,
            self.bias_force,
            self.passive_force,
            bias,
            result,
        )
        return result[:nv], result[nv:]
