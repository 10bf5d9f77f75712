# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A set of active closures: the model that kernels take, dense, and sparse where it is quicker."""

from __future__ import annotations

from functools import cached_property

import numpy as np

from hapticmech_ros.arrays import Array
from hapticmech_ros.mechanism.kernels.model import Constants, Model, data_size, pack


class ActiveSet:
    """What a set of active closures fixes, for one kind of factorisation.

    Attributes:
        known: the mechanism's constants, with these closures.
        constants: these, packed.
        model: views of the packed ones.
        m: number of closure rows.
        size: length of a packed array.
        dense: the same closures with a dense factorisation; itself, if it is dense.
        redundant: of a sparse one, whether rows follow from others.
    """

    def __init__(
        self, known: Constants, dense: ActiveSet | None = None, redundant: bool = False
    ) -> None:
        self.known = known
        self.constants: tuple[Array, Array] = pack(known)
        self.model = Model(*self.constants)
        self.m = known.m
        self.size = data_size(self.model)
        self.dense: ActiveSet = self if dense is None else dense
        self.redundant = redundant

    @property
    def is_sparse(self) -> bool:
        """Whether the factorisation is sparse, and may have to be done again by the dense one."""
        return self.dense is not self

    @cached_property
    def scratch(self) -> Array:
        """A packed array (size,) for terms that are not kept."""
        return np.empty(self.size)

    def first_terms(self, known: Array | None, steps: int) -> Array:
        """Return the packed terms (size,) that a kernel begins with: known, or to be filled.

        Args:
            known: (size,) or None; it is copied for many steps, which change it.
            steps: that the kernel does.
        """
        if known is None:
            return np.empty(self.size)
        return known if steps == 1 else known.copy()
