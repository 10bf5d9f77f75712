"""What the closures leave of the motions, in the array that kernels fill."""

from __future__ import annotations

import numpy as np

from hapticmech_ros.mechanism.constraint_space import ConstraintSpace
from hapticmech_ros.mechanism.kernels import correct, keep_closed
from hapticmech_ros.mechanism.model import Array


class CompiledSpace(ConstraintSpace):
    """A :class:`ConstraintSpace` in one array; its parts are views made when asked for.

    Attributes:
        packed: see :mod:`~hapticmech_ros.mechanism.kernels`.
        nv: number of rates.
        m: number of closure rows.
    """

    __slots__ = ("_rank", "m", "nv", "packed")
    packed: Array
    nv: int
    m: int
    _rank: int

    def __init__(self, packed: Array, nv: int, m: int, rank: int) -> None:
        fill = object.__setattr__  # the parent is frozen
        fill(self, "packed", packed)
        fill(self, "nv", nv)
        fill(self, "m", m)
        fill(self, "_rank", rank)

    @property
    def rank(self) -> int:
        """Number r of independent closure rows."""
        return self._rank

    @property
    def factor(self) -> Array:
        """(nv, nv) lower Cholesky factor L of D."""
        return self.packed[: self.nv * self.nv].reshape(self.nv, self.nv)

    @property
    def basis(self) -> Array:
        """(nv, r) U, orthonormal basis of range(L⁻¹Wᵀ)."""
        start = self._spectral_start()
        return self.packed[start : start + self.rank * self.nv].reshape(self.rank, self.nv).T

    @property
    def sigma(self) -> Array:
        """(r,) singular values kept, of rows scaled by their unit."""
        start = self._spectral_start() + min(self.m, self.nv) * self.nv
        return self.packed[start : start + self.rank]

    @property
    def rows(self) -> Array:
        """(m, r) V / row length."""
        start = self._spectral_start() + min(self.m, self.nv) * (self.nv + 1)
        return self.packed[start : start + self.rank * self.m].reshape(self.rank, self.m).T

    def correction(self, rows: Array) -> Array:
        """Return D⁻¹Wᵀ(W D⁻¹Wᵀ)⁺ rows: of all changes with W change = rows the smallest."""
        change = np.empty(self.nv)
        correct(self.packed, self.nv, self.m, self._rank, np.ascontiguousarray(rows), change)
        return change

    def closed_rates(self, rates: Array) -> Array:
        """Return the rates nearest to ``rates`` in the mass metric that keep the loops closed."""
        kept = np.array(rates, dtype=float)
        keep_closed(self.packed, self.nv, self.m, self._rank, kept)
        return kept

    def _spectral_start(self) -> int:
        return self.nv * self.nv + self.m * (self.nv + 1)
