"""Rank-revealing factorisation of the loop closures in the mass metric.

With D = L Lᵀ, the columns of A = L⁻¹Wᵀ span the forces that the loops can transmit. The thin SVD
A = U diag(σ) Vᵀ, cut at the solver's rank tolerance, gives every constrained quantity without ever
forming W D⁻¹ Wᵀ, whose condition number is the square of A's. T1 of docs/derivations.md.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from hapticmech_ros.errors import HapticMechError
from hapticmech_ros.mechanism.lapack import dgesdd, dpotrf, dtrsm, dtrsv
from hapticmech_ros.mechanism.model import Array, TreeModel

# Singular values of A below this fraction of the largest carry no force: redundant closures.
# This is a numerical tolerance; which directions a user feels as rigid is another question.
SOLVER_RANK_TOLERANCE = 1e-8
# Below this fraction of the largest one a singular value is the rounding of rows that follow from
# others. One between the two says that a singular position is near.
RESOLVED = 1e-11
# Where one is below this share of the largest, what rounding leaves of φ turns the closures' rows
# by 1e-4 and more.
NEAR = 1e-6
# A step that passes a singular position needs care from further off: at speed a turn of the rows by
# 1e-7 already costs energy. It passes one if it moves a joint by more, rad or m, than σ is from 0.
PASSING = 1e-4
# Off the closures by a residual δ (relative to the mechanism's length), as the inner stages of a
# step are, rows that depend on each other on the closures differ by the order of δ: 0.2 δ was
# measured on duplicated spatial loops. Singular values below this many δ say nothing; the cap keeps
# far-off poses, from which a loop is being closed, from losing rows that they need.
DRIFT_FACTOR = 10.0
DRIFT_CAP = 1e-4
# A joint's inertia below this fraction of what its mass has at the mechanism's length is rounding.
NO_INERTIA = 1e-15


class SingularInertiaError(HapticMechError):
    """D is not positive definite: some joint moves no mass.

    Attributes:
        rate: first degree of freedom at which D is not.
    """

    def __init__(self, message: str, rate: int) -> None:
        super().__init__(message)
        self.rate = rate


@dataclass(frozen=True, slots=True)
class ConstraintSpace:
    """Orthonormal description of the closures' forces in the mass metric.

    Attributes:
        factor: (nv, nv) lower Cholesky factor L of D.
        basis: (nv, r) U, orthonormal basis of range(L⁻¹Wᵀ).
        sigma: (r,) singular values kept, of rows scaled by ``row_lengths``.
        rows: (m, r) V / row length: maps coordinates in U back to the rows of W.
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

    def multipliers(self, along_basis: Array) -> Array:
        """Return the smallest (scaled) λ with L⁻¹Wᵀ λ = U along_basis."""
        return np.asarray(self.rows @ (along_basis / self.sigma))


def cholesky_of_upper(inertia_upper: Array) -> Array:
    """Return the lower factor L of D given D's upper triangle.

    Raises:
        SingularInertiaError: D is not positive definite.
    """
    upper, info = dpotrf(inertia_upper, lower=0, clean=1)
    if info != 0:
        raise singular_inertia(info - 1)
    return np.asarray(upper.T)


def singular_inertia(rate: int) -> SingularInertiaError:
    """Return the error of a D that is not positive definite at this degree of freedom."""
    return SingularInertiaError(
        f"joint-space inertia is not positive definite at degree of freedom {rate}: "
        "every joint must move some mass",
        rate,
    )


def singular_joint(tree: TreeModel, rate: int) -> SingularInertiaError:
    """Return the error of a configuration at which D is not positive definite at ``rate``."""
    index = next(i for i in range(len(tree.joints)) if tree.velocity_slice(i).stop > rate)
    message = f"joint {tree.joint_names[index]!r} moves no mass that others do not move as well"
    return SingularInertiaError(f"{message}: {_remedy(tree, index)}", rate)


def refuse_massless(tree: TreeModel, length: float) -> None:
    """Check that every joint moves mass or inertia somewhere.

    A joint's part of D is analytic in q: where it is singular at a configuration that nothing
    singles out, it is so everywhere.

    Args:
        tree: the mechanism's.
        length: unit of angular rates, m.

    Raises:
        SingularInertiaError: a joint moves none at any configuration; names joint and link.
    """
    model = tree.pinocchio
    data = model.createData()
    somewhere = np.cos(1.0 + 1.7 * np.arange(model.nv))
    q = pin.integrate(model, pin.neutral(model), somewhere)
    inertia = np.triu(pin.crba(model, data, q).reshape(model.nv, model.nv))
    pin.computeSubtreeMasses(model, data)
    for index, kind in enumerate(tree.joint_types):
        part = tree.velocity_slice(index)
        units = length ** np.array(_ANGULAR[kind])
        block = inertia[part, part] / np.outer(units, units)
        least = np.linalg.eigvalsh(block, UPLO="U")[0]
        if least <= NO_INERTIA * data.mass[index + 1]:
            message = f"joint {tree.joint_names[index]!r} moves no mass: {_remedy(tree, index)}"
            raise SingularInertiaError(message, part.start)


# 1 for angular rates of a joint, 0 for linear ones.
_ANGULAR: dict[str, tuple[float, ...]] = {
    "revolute": (1.0,),
    "prismatic": (0.0,),
    "spherical": (1.0, 1.0, 1.0),
    "free": (0.0, 0.0, 0.0, 1.0, 1.0, 1.0),
    "planar": (0.0, 0.0, 1.0),
}


def _remedy(tree: TreeModel, index: int) -> str:
    link = tree.links[index]
    return f"give link {link!r} or one of its children a mass or inertia, or lock the joint"


def solve_lower(factor: Array, columns: Array) -> Array:
    """Return factor⁻¹ columns for a lower triangular factor and a matrix of columns.

    BLAS's trsm rather than LAPACK's trtrs: the latter starts threads for the smallest matrices.
    """
    return np.asarray(dtrsm(1.0, factor, columns, lower=1))


def constraint_space(
    factor: Array,
    jacobian: Array,
    row_lengths: Array,
    residual: Array,
) -> ConstraintSpace:
    """Factor the active closures.

    Args:
        factor: (nv, nv) L with D = L Lᵀ.
        jacobian: (m, nv) W; m may be 0.
        row_lengths: (m,) unit of each row, so that the rank does not depend on metres or radians.
        residual: (m,) φ, which bounds how far the rows can be trusted.
    """
    nv = factor.shape[0]
    if jacobian.shape[0] == 0:
        return ConstraintSpace(factor, np.zeros((nv, 0)), np.zeros(0), np.zeros((0, 0)))
    scaled = solve_lower(factor, (jacobian / row_lengths[:, None]).T)
    left, sigma, right, info = dgesdd(scaled, full_matrices=0)
    if info != 0:
        raise HapticMechError(f"SVD of the loop closures did not converge (LAPACK info {info})")
    drift = DRIFT_FACTOR * float(np.abs(residual / row_lengths).max())
    tolerance = max(SOLVER_RANK_TOLERANCE, min(drift, DRIFT_CAP))
    rank = int((sigma > tolerance * sigma[0]).sum()) if sigma[0] > 0.0 else 0
    resolved = int((sigma > RESOLVED * sigma[0]).sum()) if sigma[0] > 0.0 else 0
    least = float(sigma[resolved - 1] / sigma[0]) if resolved else 1.0
    rows = right[:rank].T / row_lengths[:, None]
    return ConstraintSpace(factor, left[:, :rank], sigma[:rank], rows, least, resolved)
