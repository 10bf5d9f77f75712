# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Eq. 1 at a state by Pinocchio's algorithms and LAPACK."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import NamedTuple

import numpy as np
import pinocchio as pin
from scipy.linalg import lapack

from hapticmech_ros.arrays import Array
from hapticmech_ros.errors import HapticMechError
from hapticmech_ros.mechanism.closures import WORLD_AXES, Active
from hapticmech_ros.mechanism.constraint_space import PointKinematics, solve_lower
from hapticmech_ros.mechanism.inertia import (
    SingularInertiaError,
    cholesky_of_upper,
    dtrsv,
    singular_joint,
)
from hapticmech_ros.mechanism.mechanism import MultibodyModel
from hapticmech_ros.mechanism.tolerances import (
    DRIFT_CAP,
    DRIFT_FACTOR,
    RESOLVED,
    SOLVER_RANK_TOLERANCE,
)
from hapticmech_ros.scene import Scene
from oracles.mechanism.closures import ReadableClosure
from oracles.mechanism.elements import ReadableElements

_NOTHING = np.zeros(0)


@dataclass(frozen=True, slots=True)
class ReadableSpace:
    """Orthonormal description of the closures' forces in the mass metric.

    Attributes:
        factor: (nv, nv) lower Cholesky factor L of D.
        basis: (nv, r) U, orthonormal basis of range(L⁻¹Wᵀ).
        sigma: (r,) singular values kept, of rows divided by ``row_units``.
        rows: (m, r) V / row unit: maps coordinates in U back to the rows of W.
        least: smallest σ that is more than rounding, be it kept or not, over the largest.
        resolved: number of those; above r next to a singular position.
    """

    factor: Array
    basis: Array
    sigma: Array
    rows: Array
    least: float = 1.0
    resolved: int = 0

    @property
    def rank(self) -> int:
        """Number r of independent closure rows."""
        return int(self.sigma.size)

    @property
    def least_kept(self) -> float:
        """Smallest σ kept, over the largest; 1 without any."""
        return float(self.sigma[-1] / self.sigma[0]) if self.sigma.size else 1.0

    def to_mass_metric(self, force: Array) -> Array:
        """Return L⁻¹ force, for a joint force (nv,) or the columns of (nv, k)."""
        if force.ndim == 1:
            return np.asarray(dtrsv(self.factor, force, lower=1))
        return solve_lower(self.factor, force)

    def from_mass_metric(self, rate: Array) -> Array:
        """Return L⁻ᵀ rate for (nv,): joint rates from coordinates of the mass metric."""
        return np.asarray(dtrsv(self.factor, rate, lower=1, trans=1))

    def size(self, change: Array) -> float:
        """Return |Lᵀ change| for (nv,): the length of a change in the mass metric."""
        return float(np.linalg.norm(self.factor.T @ change))

    def without_closure_part(self, columns: Array) -> Array:
        """Return (1 - U Uᵀ) columns: what the closures leave free."""
        if self.rank == 0:
            return columns
        return np.asarray(columns - self.basis @ (self.basis.T @ columns))

    def correction(self, rows: Array) -> Array:
        """Return D⁻¹Wᵀ(W D⁻¹Wᵀ)⁺ rows: of all changes with W change = rows the smallest."""
        return self.from_mass_metric(self.basis @ ((self.rows.T @ rows) / self.sigma))

    def closed_rates(self, rates: Array) -> Array:
        """Return the rates nearest to ``rates`` in the mass metric that keep the loops closed."""
        return self.from_mass_metric(self.without_closure_part(self.factor.T @ rates))


def constraint_space(
    factor: Array,
    jacobian: Array,
    row_lengths: Array,
    row_units: Array,
    residual: Array,
) -> ReadableSpace:
    """Factor the active closures.

    Args:
        factor: (nv, nv) L with D = L Lᵀ.
        jacobian: (m, nv) W; m may be 0.
        row_lengths: (m,) the length for rows in m, 1 for rows in rad.
        row_units: (m,) that times a number per closure, so that the rank does not depend on metres
            or radians, heavy or light links.
        residual: (m,) φ, which bounds how far the rows can be trusted.
    """
    nv = factor.shape[0]
    if jacobian.shape[0] == 0:
        return ReadableSpace(factor, np.zeros((nv, 0)), np.zeros(0), np.zeros((0, 0)))
    scaled = solve_lower(factor, (jacobian / row_units[:, None]).T)
    left, sigma, right, info = lapack.dgesdd(scaled, full_matrices=0)
    if info != 0:
        raise HapticMechError(f"SVD of the loop closures did not converge (LAPACK info {info})")
    drift = DRIFT_FACTOR * float(np.abs(residual / row_lengths).max())
    tolerance = max(SOLVER_RANK_TOLERANCE, min(drift, DRIFT_CAP))
    rank = int((sigma > tolerance * sigma[0]).sum()) if sigma[0] > 0.0 else 0
    resolved = int((sigma > RESOLVED * sigma[0]).sum()) if sigma[0] > 0.0 else 0
    least = float(sigma[resolved - 1] / sigma[0]) if resolved else 1.0
    rows = right[:rank].T / row_units[:, None]
    return ReadableSpace(factor, left[:, :rank], sigma[:rank], rows, least, resolved)


@dataclass(frozen=True, slots=True)
class ReadableClosing:
    """Active closures at a configuration: φ (m,), W (m, nv), and the factorisation of D and W."""

    residual: Array
    jacobian: Array
    space: ReadableSpace

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


class ReadableEvaluation(NamedTuple):
    """All terms of Eq. 1 at one state; see ``mechanism.evaluation.Evaluation``."""

    bias_force: Array
    passive_force: Array
    dissipative_force: Array
    effort: Array
    closure_bias: Array
    closing: ReadableClosing
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
    def space(self) -> ReadableSpace:
        """Factorisation of D and W."""
        return self.closing.space

    @property
    def inertia(self) -> Array:
        """Return D (nv, nv) = L Lᵀ, symmetric."""
        return np.asarray(self.space.factor @ self.space.factor.T)

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
        return acceleration, np.asarray(space.rows @ (surplus / space.sigma))


class ReadableMechanism(MultibodyModel):
    """A scene's mechanism, evaluated at states.

    The only mutable part is Pinocchio's scratch data; every result is a copy.
    """

    def __init__(self, scene: Scene) -> None:
        super().__init__(scene)
        self.closures = tuple(
            ReadableClosure(*(getattr(loop, field.name) for field in fields(loop)))
            for loop in self.closures
        )
        self.elements = ReadableElements(self.tree, self.elements.springs, self.length)
        self._zero = np.zeros(self.nv)
        self._choices: dict[Active, tuple[list[ReadableClosure], Array, Array]] = {}

    def evaluate(
        self, q: Array, v: Array, active: Active, closing: ReadableClosing | None = None
    ) -> ReadableEvaluation:
        """Evaluate every term of Eq. 1 at (q, v) with the given closures active.

        Args:
            q: (nq,) configuration.
            v: (nv,) rates.
            active: which closures are closed.
            closing: what :meth:`closing_terms` gave at the same q and closures, to save time.

        Raises:
            SingularInertiaError: D is not positive definite.
        """
        if closing is None:
            closing = self.closing_terms(q, active)
        model, data = self.model, self.data
        pin.computeAllTerms(model, data, q, v)
        # Once more, for accelerations at v̇ = 0 that do not contain gravity.
        pin.forwardKinematics(model, data, q, v, self._zero)
        pin.updateFramePlacements(model, data)
        passive, dissipative = self.elements.forces(model, data, q, v)
        return ReadableEvaluation(
            bias_force=data.nle + self._carried(data),
            passive_force=passive,
            dissipative_force=dissipative,
            effort=self.elements.effort,
            closure_bias=self._closure_bias(active),
            closing=closing,
            points=tuple(self._point(frame, v) for frame in self._point_frames),
            v=v,
        )

    def closing_terms(self, q: Array, active: Active) -> ReadableClosing:
        """Return φ, W and the factorisation at q: what projections need.

        Raises:
            SingularInertiaError: D is not positive definite at q.
        """
        model, data = self.model, self.data
        try:
            factor = cholesky_of_upper(pin.crba(model, data, q).reshape(self.nv, self.nv))
        except SingularInertiaError as error:
            raise singular_joint(self.tree, error.rate) from None
        pin.computeJointJacobians(model, data, q)
        pin.updateFramePlacements(model, data)
        loops, lengths, units = self._chosen(active)
        if len(loops) == 1:
            residual, jacobian = loops[0].residual(model, data), loops[0].jacobian(model, data)
        elif loops:
            residual = np.concatenate([loop.residual(model, data) for loop in loops])
            jacobian = np.vstack([loop.jacobian(model, data) for loop in loops])
        else:
            residual, jacobian = _NOTHING, np.zeros((0, self.nv))
        space = constraint_space(factor, jacobian, lengths, units, residual)
        return ReadableClosing(residual, jacobian, space)

    def slopes(self, q: Array, v: Array, horizon: float) -> tuple[Array, Array]:
        """Return how passive forces resist change: stiffness and damping, each (nv, nv).

        Symmetric, positive semi-definite approximations of -∂τ/∂q and -∂τ/∂v. Friction counts with
        its secant, a stop if it is met or will be within ``horizon`` (s) at the present speed, and
        springs between points as if their direction stayed.
        """
        pin.computeJointJacobians(self.model, self.data, q)
        pin.updateFramePlacements(self.model, self.data)
        return self.elements.slopes(self.model, self.data, q, v, horizon)

    def distance_of(self, index: int, q: Array, v: Array) -> tuple[float, float]:
        """Return |φ| of closure ``index``, active or not, and the rate at which it grows."""
        pin.computeJointJacobians(self.model, self.data, q)
        pin.updateFramePlacements(self.model, self.data)
        residual = self.closures[index].residual(self.model, self.data)
        distance = float(np.sqrt(residual @ residual))
        rate = residual @ (self.closures[index].jacobian(self.model, self.data) @ v)
        return distance, float(rate) / distance if distance > 0.0 else 0.0

    def _carried(self, data: pin.Data) -> Array:
        """Return by how much h is less for what carries links: a force at each centre of mass."""
        lift = np.zeros(self.nv)
        for link in self.scene.links:
            joint, place = self.tree.link_joint[link.name]
            at = data.oMi[joint].act(place.act(np.array(link.inertial.com)))
            axes = pin.getJointJacobian(self.model, data, joint, pin.WORLD)
            weight = link.gravcomp * link.inertial.mass * np.array(self.scene.gravity)
            lift += axes.T @ np.concatenate((weight, np.cross(at, weight)))
        return lift

    def _point(self, frame: int, v: Array) -> PointKinematics:
        model, data = self.model, self.data
        jacobian = pin.getFrameJacobian(model, data, frame, WORLD_AXES).reshape(6, self.nv)
        drift = pin.getFrameClassicalAcceleration(model, data, frame, WORLD_AXES).vector
        return PointKinematics(data.oMf[frame].copy(), jacobian, jacobian @ v, drift)

    def _closure_bias(self, active: Active) -> Array:
        loops, _, _ = self._chosen(active)
        if len(loops) == 1:
            return loops[0].bias(self.model, self.data)
        if not loops:
            return _NOTHING
        return np.concatenate([loop.bias(self.model, self.data) for loop in loops])

    def _chosen(self, active: Active) -> tuple[list[ReadableClosure], Array, Array]:
        """Return the active closures, their rows' lengths and units; found once per set."""
        if active not in self._choices:
            loops = [loop for loop, on in zip(self.closures, active, strict=True) if on]
            lengths = [_NOTHING, *(loop.row_lengths(self.length) for loop in loops)]
            units = self.row_units([index for index, on in enumerate(active) if on])
            self._choices[active] = (loops, np.concatenate(lengths), units)
        return self._choices[active]
