# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Rank-revealing factorisation of the loop closures in the mass metric, in the array of a kernel.

With D = L Lᵀ, the columns of A = L⁻¹Wᵀ span the forces that the loops can transmit. The thin SVD
A = U diag(σ) Vᵀ, cut at the solver's rank tolerance, gives every constrained quantity without ever
forming W D⁻¹ Wᵀ, whose condition number is the square of A's. T1 of docs/derivations.md. Where
nothing is near to being cut a QR takes its place: U is then another basis of the same space, σ the
diagonal of R, and V such that A⁺ = V diag(σ)⁻¹ Uᵀ as before.

Terms of Eq. 1 of a mechanism, at a configuration and at a state.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pinocchio as pin

from hapticmech_ros.errors import HapticMechError
from hapticmech_ros.mechanism.inertia import dtrsm, dtrsv, singular_joint
from hapticmech_ros.mechanism.kernels.band_kernels import NOT_DECIDED
from hapticmech_ros.mechanism.kernels.energy_kernels import weights_and_springs
from hapticmech_ros.mechanism.kernels.factor_kernels import NO_SVD, SINGULAR, factor
from hapticmech_ros.mechanism.kernels.layout import ActiveSet
from hapticmech_ros.mechanism.kernels.metric_kernels import (
    accelerate,
    close_rates,
    correction_of,
    lift,
)
from hapticmech_ros.mechanism.kernels.model import Data, tail_of
from hapticmech_ros.mechanism.model import TreeModel
from hapticmech_ros.numerics import Array


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
        terms = self.bias_force, self.passive_force, bias
        accelerate(dense.active_set.model, dense.parts, *terms, result)
        return result[:nv], result[nv:]


class Closing:
    """Active closures at a configuration: φ, W, and the factorisation of D and W, in one array.

    Attributes:
        tree: the mechanism's, which gives degrees of freedom names.
        active_set: the closures that are active, and the kind of factorisation.
        packed: see :class:`~hapticmech_ros.mechanism.kernels.model.Data`.
        q: (nq,) configuration.
    """

    __slots__ = ("_twin", "active_set", "packed", "q", "tree")

    def __init__(self, tree: TreeModel, active_set: ActiveSet, packed: Array, q: Array) -> None:
        self.tree = tree
        self.active_set = active_set
        self.packed = packed
        self.q = q
        self._twin: Closing | None = None

    @property
    def dense(self) -> Closing:
        """The same with a dense factorisation, computed on access."""
        if not self.active_set.is_sparse:
            return self
        if self._twin is None:
            self._twin = factored(self.tree, self.active_set.dense, self.q)
        return self._twin

    @property
    def parts(self) -> Data:
        """Views of the array's parts."""
        return Data(self.active_set.model.numbers, self.packed)

    @property
    def space(self) -> ConstraintSpace:
        """The factorisation of D and W."""
        return ConstraintSpace(self)

    @property
    def residual(self) -> Array:
        """(m,) φ, m and rad, world axes; see docs/notation.md."""
        return self.packed[: self.active_set.m]

    @property
    def jacobian(self) -> Array:
        """(m, nv) W, in m and 1: φ̇ = W v."""
        return self.dense.parts.jacobian

    @property
    def potential_energy(self) -> float:
        """Energy of weights, springs and stops, J."""
        return weights_and_springs(self.active_set.model, self.parts, self.q)

    @property
    def error(self) -> float:
        """Largest |φ|, m or rad; 0 without closures."""
        return tail_of(self.packed).largest_residual

    @property
    def rank(self) -> int:
        """Number r of independent closure rows."""
        return int(tail_of(self.packed).rank)

    @property
    def least(self) -> float:
        """Smallest σ that is more than rounding over the largest; 1 without closures."""
        return tail_of(self.packed).least_sigma


class ConstraintSpace:
    """Orthonormal description of the closures' forces in the mass metric.

    Parts are views of the array of a closing, made on access. A sparse factorisation has another L,
    with L Lᵀ = D as well, and neither L nor U as a matrix: a dense factorisation of the same
    closures then provides values in coordinates of the mass metric.
    """

    __slots__ = ("closing",)

    def __init__(self, closing: Closing) -> None:
        self.closing = closing

    @property
    def factor(self) -> Array:
        """(nv, nv) lower Cholesky factor L of D, joint coordinates."""
        return self.closing.dense.parts.factor

    @property
    def basis(self) -> Array:
        """(nv, r) U, orthonormal basis of range(L⁻¹Wᵀ)."""
        return self.closing.dense.parts.basis[: self.rank].T

    @property
    def sigma(self) -> Array:
        """(r,) singular values kept, or R's diagonal, of rows divided by their units."""
        return self.closing.dense.parts.sigma[: self.rank]

    @property
    def rows(self) -> Array:
        """(m, r) V over row units (m or 1): maps coordinates in U back to the rows of W."""
        return self.closing.dense.parts.rows[: self.rank].T

    @property
    def rank(self) -> int:
        """Number r of independent closure rows."""
        return self.closing.rank

    @property
    def least_kept(self) -> float:
        """Smallest σ kept over the largest one; 1 without any."""
        if self.closing.active_set.is_sparse:
            return self.closing.least
        sigma = self.sigma
        return float(sigma[-1] / sigma[0]) if sigma.size else 1.0

    def to_mass_metric(self, force: Array) -> Array:
        """Return L⁻¹ force, N/√kg, for a joint force (nv,) or the columns of (nv, k).

        Args:
            force: (nv,) or (nv, k) joint forces, N m or N.
        """
        if force.ndim == 1:
            return np.asarray(dtrsv(self.factor, force, lower=1))
        return solve_lower(self.factor, force)

    def from_mass_metric(self, rate: Array) -> Array:
        """Return L⁻ᵀ rate for (nv,): joint rates from coordinates of the mass metric.

        Args:
            rate: (nv,) in the mass metric, √kg m/s; with √kg m the result is in rad or m.
        """
        return np.asarray(dtrsv(self.factor, rate, lower=1, trans=1))

    def size(self, change: Array) -> float:
        """Return |Lᵀ change|, √kg m (√kg m/s of rates): the length in the mass metric.

        Args:
            change: (nv,) rad or m; or rates, rad/s or m/s.
        """
        lifted = np.array(change, dtype=float)
        closing = self.closing
        lift(closing.active_set.model, closing.parts, lifted)
        return float(np.sqrt(lifted @ lifted))

    def without_closure_part(self, columns: Array) -> Array:
        """Return the free part (1 - U Uᵀ) columns, of the same shape (nv,) or (nv, k).

        Args:
            columns: (nv,) or (nv, k) in the mass metric.
        """
        if self.rank == 0:
            return columns
        return np.asarray(columns - self.basis @ (self.basis.T @ columns))

    def correction(self, rows: Array) -> Array:
        """Return D⁻¹Wᵀ(W D⁻¹Wᵀ)⁺ rows (nv,): of all changes with W change = rows the smallest.

        Args:
            rows: (m,) of φ, rad or m; the result is in rad or m likewise.
        """
        closing = self.closing
        change = np.empty(closing.active_set.model.nv)
        rows = np.ascontiguousarray(rows, dtype=float)
        correction_of(closing.active_set.model, closing.parts, rows, change)
        return change

    def closed_rates(self, rates: Array) -> Array:
        """Return the rates (nv,) nearest to ``rates`` in the mass metric that keep loops closed.

        Args:
            rates: (nv,) rad/s or m/s.
        """
        kept = np.array(rates, dtype=float)
        close_rates(self.closing.active_set.model, self.closing.parts, kept)
        return kept


def factored(tree: TreeModel, active_set: ActiveSet, q: Array) -> Closing:
    """Return the terms of closures at q (nq,); dense where a sparse factorisation cannot decide.

    Args:
        tree: the mechanism's.
        active_set: the closures.
        q: (nq,) configuration.

    Raises:
        SingularInertiaError: D is not positive definite at q.
        HapticMechError: the SVD did not converge.
    """
    packed, position = np.empty(active_set.size), np.array(q, dtype=float)
    code = factor(active_set.model, position, Data(active_set.model.numbers, packed))
    if code == NOT_DECIDED:
        return factored(tree, active_set.dense, q)
    if code < 0:
        raise failure(code, tree)
    return Closing(tree, active_set, packed, position)


def failure(code: int, tree: TreeModel) -> HapticMechError:
    """Return the error of a kernel's negative code."""
    if code == NO_SVD:
        return HapticMechError("SVD of the loop closures did not converge")
    return singular_joint(tree, SINGULAR - code)


def solve_lower(factor: Array, columns: Array) -> Array:
    """Return factor⁻¹ columns, (n, k), for a lower triangular factor.

    BLAS's trsm rather than LAPACK's trtrs: the latter starts threads for the smallest matrices.

    Args:
        factor: (n, n).
        columns: (n, k).
    """
    return np.asarray(dtrsm(1.0, factor, columns, lower=1))
