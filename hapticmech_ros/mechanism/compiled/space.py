"""What the closures leave of the motions, in the array that kernels fill."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from hapticmech_ros.mechanism.compiled.chosen import Chosen
from hapticmech_ros.mechanism.compiled.kernels import correct, keep_closed, lift_rates
from hapticmech_ros.mechanism.compiled.packed import (
    ERROR,
    LEAST,
    RANK,
    RESOLVED_RANK,
    Packed,
    views_of,
)
from hapticmech_ros.mechanism.constraint_space import ConstraintSpace
from hapticmech_ros.mechanism.evaluation import Closing
from hapticmech_ros.mechanism.model import Array

if TYPE_CHECKING:
    from hapticmech_ros.mechanism.compiled.mechanism import CompiledMechanism


class CompiledClosing(Closing):
    """φ, W, and what kernels made of them and of D at a configuration, in one array.

    Attributes:
        packed: see :class:`~hapticmech_ros.mechanism.compiled.packed.Packed`.
        mechanism: whose.
        chosen: the closures that are active, and the kind of factorisation.
        q: (nq,) configuration.
    """

    __slots__ = ("_twin", "chosen", "mechanism", "packed", "q")
    mechanism: CompiledMechanism
    chosen: Chosen
    packed: Array
    q: Array
    _twin: CompiledClosing | None

    def __init__(
        self, mechanism: CompiledMechanism, chosen: Chosen, packed: Array, q: Array
    ) -> None:
        # The parent is frozen.
        write = object.__setattr__
        write(self, "mechanism", mechanism)
        write(self, "chosen", chosen)
        write(self, "packed", packed)
        write(self, "q", q)
        write(self, "_twin", None)

    @property
    def dense(self) -> CompiledClosing:
        """The same with a dense factorisation, computed when it is asked for."""
        if not self.chosen.is_sparse:
            return self
        twin = self._twin
        if twin is None:
            twin = self.mechanism.factored(self.chosen.dense, self.q)
            object.__setattr__(self, "_twin", twin)
        return twin

    @property
    def parts(self) -> Packed:
        """Views of the array's parts."""
        return views_of(self.packed, self.chosen.tables)

    @property
    def space(self) -> CompiledSpace:
        """The factorisation of D and W."""
        return CompiledSpace(self)

    @property
    def residual(self) -> Array:
        """(m,) φ."""
        return self.packed[: self.chosen.m]

    @property
    def jacobian(self) -> Array:
        """(m, nv) W."""
        return self.dense.parts.jacobian

    @property
    def error(self) -> float:
        """Largest |φ|, m or rad; 0 without closures."""
        return float(self.packed.item(ERROR))

    @property
    def rank(self) -> int:
        """Number r of independent closure rows."""
        return int(self.packed.item(RANK))

    @property
    def least(self) -> float:
        """Smallest σ that is more than rounding over the largest; 1 without closures."""
        return float(self.packed.item(LEAST))

    @property
    def resolved(self) -> int:
        """Number of rows that differ by more than rounding."""
        return int(self.packed.item(RESOLVED_RANK))


class CompiledSpace(ConstraintSpace):
    """A :class:`ConstraintSpace` in the array of a closing; parts are views made when asked for.

    A sparse factorisation has another L, with L Lᵀ = D as well, and neither L nor U as a matrix:
    what is asked for in coordinates of the mass metric is then given by its dense twin.
    """

    __slots__ = ("closing",)
    closing: CompiledClosing

    def __init__(self, closing: CompiledClosing) -> None:
        object.__setattr__(self, "closing", closing)

    @property
    def factor(self) -> Array:
        """(nv, nv) lower Cholesky factor L of D."""
        return self.closing.dense.parts.factor

    @property
    def basis(self) -> Array:
        """(nv, r) U, orthonormal basis of range(L⁻¹Wᵀ)."""
        return self.closing.dense.parts.basis[: self.rank].T

    @property
    def sigma(self) -> Array:
        """(r,) singular values kept, of rows scaled by their unit."""
        return self.closing.dense.parts.sigma[: self.rank]

    @property
    def rows(self) -> Array:
        """(m, r) V / row length."""
        return self.closing.dense.parts.rows[: self.rank].T

    @property
    def rank(self) -> int:
        """Number r of independent closure rows."""
        return self.closing.rank

    @property
    def least(self) -> float:
        """Smallest σ that is more than rounding over the largest; 1 without closures."""
        return self.closing.least

    @property
    def resolved(self) -> int:
        """Number of rows that differ by more than rounding."""
        return self.closing.resolved

    def size(self, change: Array) -> float:
        """Return |Lᵀ change| for (nv,): the length of a change in the mass metric."""
        lifted = np.array(change, dtype=float)
        closing = self.closing
        lift_rates(*closing.chosen.constants, closing.packed, lifted)
        return float(np.sqrt(lifted @ lifted))

    def correction(self, rows: Array) -> Array:
        """Return D⁻¹Wᵀ(W D⁻¹Wᵀ)⁺ rows: of all changes with W change = rows the smallest."""
        closing = self.closing
        change = np.empty(closing.chosen.tables.nv)
        rows = np.ascontiguousarray(rows, dtype=float)
        correct(*closing.chosen.constants, closing.packed, rows, change)
        return change

    def closed_rates(self, rates: Array) -> Array:
        """Return the rates nearest to ``rates`` in the mass metric that keep the loops closed."""
        kept = np.array(rates, dtype=float)
        keep_closed(*self.closing.chosen.constants, self.closing.packed, kept)
        return kept
