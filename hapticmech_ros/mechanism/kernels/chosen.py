"""A set of active closures: the tables that kernels take, dense, and sparse where it is quicker."""

from __future__ import annotations

from functools import cached_property

import numpy as np

from hapticmech_ros.arrays import Array
from hapticmech_ros.mechanism.kernels.packed import packed_size
from hapticmech_ros.mechanism.kernels.tables import Constants, Tables, fold


class Chosen:
    """What a set of active closures fixes, for one kind of factorisation.

    Attributes:
        known: the mechanism's constants, with these closures.
        constants: these, folded.
        tables: views of the folded ones.
        m: number of closure rows.
        size: length of a packed array.
        dense: the same closures with a dense factorisation; itself, if it is dense.
        redundant: of a sparse one, whether rows follow from others.
    """

    def __init__(
        self, known: Constants, dense: Chosen | None = None, redundant: bool = False
    ) -> None:
        self.known = known
        self.constants: tuple[Array, Array] = fold(known)
        self.tables = Tables(*self.constants)
        self.m = known.m
        self.size = packed_size(self.tables)
        self.dense: Chosen = self if dense is None else dense
        self.redundant = redundant

    @property
    def is_sparse(self) -> bool:
        """Whether the factorisation is sparse, and may have to be done again by the dense one."""
        return self.dense is not self

    @cached_property
    def scratch(self) -> Array:
        """A packed array for terms that nobody keeps."""
        return np.empty(self.size)
