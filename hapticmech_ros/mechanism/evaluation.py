"""Terms of Eq. 1: what a mechanism says of itself at a configuration, and at a state."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from hapticmech_ros.mechanism.constraint_space import ConstraintSpace
from hapticmech_ros.mechanism.model import Array

Active = tuple[bool, ...]


@dataclass(frozen=True, slots=True)
class Closing:
    """Active closures at a configuration: φ (m,), W (m, nv), and the factorisation of D and W."""

    residual: Array
    jacobian: Array
    space: ConstraintSpace

    @property
    def error(self) -> float:
        """Largest |φ|, m or rad; 0 without closures."""
        return float(np.abs(self.residual).max()) if self.residual.size else 0.0

    @property
    def rank(self) -> int:
        """Number r of independent rows."""
        return self.space.rank

    @property
    def least(self) -> float:
        """Smallest σ that is more than rounding over the largest; 1 without closures."""
        return self.space.least

    @property
    def resolved(self) -> int:
        """Number of rows that differ by more than rounding."""
        return self.space.resolved


class PointKinematics(NamedTuple):
    """An operational point at a state, axes of the world, origin at the point.

    Attributes:
        pose: point frame in the world.
        jacobian: (6, nv) J_h, linear rows first.
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
        bias_force: (nv,) h, Coriolis, centripetal and gravity terms.
        passive_force: (nv,) springs, dampers, friction and stops, N m or N.
        dissipative_force: (nv,) the part of these that only takes energy.
        effort: (nv,) constant forces of the joints.
        closure_bias: (m,) Ẇv.
        closing: φ, W and their factorisation.
        points: operational points in the scene's order.
        v: (nv,) rates at which they were evaluated.
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
        """(m, nv) W of the active closures."""
        return self.closing.jacobian

    @property
    def space(self) -> ConstraintSpace:
        """Factorisation of D and W."""
        return self.closing.space

    @property
    def inertia(self) -> Array:
        """Return D (nv, nv) = L Lᵀ, symmetric."""
        factor = self.space.factor
        return np.asarray(factor @ factor.T)

    def acceleration(self, joint_force: Array) -> tuple[Array, Array]:
        """Solve Eq. 1 for joint forces Σ Jᵀ F, on top of passive forces and efforts.

        Returns:
            v̇ (nv,) and closure forces λ (m,), the smallest ones where closures are redundant.
        """
        space = self.space
        own = self.effort + self.passive_force - self.bias_force
        free = space.to_mass_metric(joint_force + own)
        if space.rank == 0:
            return space.from_mass_metric(free), np.zeros(self.closure_bias.size)
        needed = -(space.rows.T @ self.closure_bias) / space.sigma
        surplus = space.basis.T @ free - needed
        acceleration = space.from_mass_metric(free - space.basis @ surplus)
        return acceleration, space.multipliers(surplus)
