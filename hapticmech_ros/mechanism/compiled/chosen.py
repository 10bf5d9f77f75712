"""A set of active closures: the tables that kernels take, dense, and sparse where it is quicker."""

from __future__ import annotations

from functools import cached_property

import numpy as np

from hapticmech_ros.mechanism.compiled.packed import packed_size
from hapticmech_ros.mechanism.compiled.tables import Tables, fold
from hapticmech_ros.mechanism.model import Array


class Chosen:
    """What a set of active closures fixes, for one kind of factorisation.

    Attributes:
        tables: the mechanism's, with these closures.
        constants: the tables, folded.
        m: number of closure rows.
        size: length of a packed array.
        dense: the same closures with a dense factorisation; itself, if it is dense.
    """

    def __init__(self, tables: Tables, dense: Chosen | None = None) -> None:
        self.tables = tables
        self.constants: tuple[Array, Array] = fold(tables)
        self.m = tables.m
        self.size = packed_size(tables)
        self.dense: Chosen = self if dense is None else dense

    @property
    def is_sparse(self) -> bool:
        """Whether the factorisation is sparse, and may have to be done again by the dense one."""
        return self.dense is not self

    @cached_property
    def scratch(self) -> Array:
        """A packed array for terms that nobody keeps."""
        return np.empty(self.size)
