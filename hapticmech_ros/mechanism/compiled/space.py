"""What the closures leave of the motions, in the array that kernels fill."""

from __future__ import annotations

import numpy as np

from hapticmech_ros.mechanism.compiled.kernels import correct, keep_closed
from hapticmech_ros.mechanism.compiled.packed import ERROR, LEAST, RANK, RESOLVED_RANK, views_of
from hapticmech_ros.mechanism.constraint_space import ConstraintSpace
from hapticmech_ros.mechanism.evaluation import Closing
from hapticmech_ros.mechanism.model import Array


class _InOneArray:
    """What a factorisation and its closures have in common: the array, and what its tail says."""

    __slots__ = ()
    packed: Array
    nv: int
    m: int

    def __init__(self, packed: Array, nv: int, m: int) -> None:
        # Parents are frozen.
        write = object.__setattr__
        write(self, "packed", packed)
        write(self, "nv", nv)
        write(self, "m", m)

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


class CompiledSpace(_InOneArray, ConstraintSpace):
    """A :class:`ConstraintSpace` in one array; its parts are views made when asked for.

    Attributes:
        packed: see :class:`~hapticmech_ros.mechanism.compiled.packed.Packed`.
        nv: number of rates.
        m: number of closure rows.
    """

    __slots__ = ("m", "nv", "packed")

    @property
    def factor(self) -> Array:
        """(nv, nv) lower Cholesky factor L of D."""
        return views_of(self.packed, self.nv, self.m).factor

    @property
    def basis(self) -> Array:
        """(nv, r) U, orthonormal basis of range(L⁻¹Wᵀ)."""
        return views_of(self.packed, self.nv, self.m).basis[: self.rank].T

    @property
    def sigma(self) -> Array:
        """(r,) singular values kept, of rows scaled by their unit."""
        return views_of(self.packed, self.nv, self.m).sigma[: self.rank]

    @property
    def rows(self) -> Array:
        """(m, r) V / row length."""
        return views_of(self.packed, self.nv, self.m).rows[: self.rank].T

    def correction(self, rows: Array) -> Array:
        """Return D⁻¹Wᵀ(W D⁻¹Wᵀ)⁺ rows: of all changes with W change = rows the smallest."""
        change = np.empty(self.nv)
        correct(
            self.packed, self.nv, self.m, self.rank, np.ascontiguousarray(rows, dtype=float), change
        )
        return change

    def closed_rates(self, rates: Array) -> Array:
        """Return the rates nearest to ``rates`` in the mass metric that keep the loops closed."""
        kept = np.array(rates, dtype=float)
        keep_closed(self.packed, self.nv, self.m, self.rank, kept)
        return kept


class CompiledClosing(_InOneArray, Closing):
    """φ, W, and what kernels made of them and of D, in one array."""

    __slots__ = ("m", "nv", "packed")

    @property
    def space(self) -> CompiledSpace:
        """The factorisation of D and W."""
        return CompiledSpace(self.packed, self.nv, self.m)

    @property
    def residual(self) -> Array:
        """(m,) φ."""
        start = self.nv**2
        return self.packed[start : start + self.m]

    @property
    def jacobian(self) -> Array:
        """(m, nv) W."""
        nv, m = self.nv, self.m
        start = nv * nv + m
        return self.packed[start : start + m * nv].reshape(m, nv)

    @property
    def error(self) -> float:
        """Largest |φ|, m or rad; 0 without closures."""
        return float(self.packed.item(ERROR))
