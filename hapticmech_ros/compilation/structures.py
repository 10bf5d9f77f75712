# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Structures that kernels hand around: two arrays, and parts of them that are found when asked for.

A kernel's functions would pass each array of a named tuple by itself, seven numbers an array, from
one to the next: for tuples of twenty arrays that takes longer than what many of the functions do.
Inside a kernel a structure is where its two arrays begin, an int64 one and a float64 one, and owns
neither, so that nobody counts who looks at a part of them: whoever calls the kernel holds them
until it returns.
"""

from __future__ import annotations

from typing import TypeVar

import numpy as np

from hapticmech_ros.compilation.decorators import is_building

Kind = TypeVar("Kind", bound=type)
Array = np.ndarray
# Numbers of a structure that come before the places of its parts; a place is three of them: where
# the part starts, its rows and its columns.
SIZES = 8


# What kernels use, in a process that builds the library; see ``numba_types.teach_structure``.
kinds: list[type] = []


class Structure:
    """Two arrays: whole numbers that say where what is, and what is there."""

    __slots__ = ("data", "numbers")

    def __init__(self, numbers: Array, data: Array) -> None:
        self.numbers = numbers
        self.data = data


class Size:
    """One of the whole numbers.

    Args:
        index: which.
    """

    def __init__(self, index: int) -> None:
        self.index = index

    def __get__(self, structure: Structure, owner: type | None = None) -> int:
        """Return the number."""
        return int(structure.numbers[self.index])


class Part:
    """A view of a part of the data.

    Args:
        index: its number in the table of places.
        dimensions: 1 for a vector, 2 for a matrix.
        whole: whether it is among the whole numbers themselves.
    """

    def __init__(self, index: int, dimensions: int, whole: bool = False) -> None:
        self.at = SIZES + 3 * index
        self.dimensions = dimensions
        self.whole = whole

    def __get__(self, structure: Structure, owner: type | None = None) -> Array:
        """Return the view."""
        start, rows, columns = structure.numbers[self.at : self.at + 3].tolist()
        data = structure.numbers if self.whole else structure.data
        found = data[start : start + rows * columns]
        return found if self.dimensions == 1 else found.reshape(rows, columns)


def structure(kind: Kind) -> Kind:
    """Return a kind of :class:`Structure` that kernels can make and read."""
    if is_building():
        kinds.append(kind)
    return kind
