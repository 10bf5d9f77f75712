# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Structures that kernels pass on: two arrays, and parts of them that are located on access.

A kernel's functions would pass each array of a named tuple separately, as seven numbers: for tuples
of twenty arrays that takes longer than many of the functions themselves. Inside a kernel a
structure is two pointers, to an int64 and a float64 array. It owns neither, and so needs no
reference counts: the kernel's caller holds them until it returns.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from typing import ClassVar, Generic, TypeVar

import numpy as np

Array = np.ndarray
Kind = TypeVar("Kind")
Kept = TypeVar("Kept")
# Numbers of a structure that come before the places of its parts; a place is three of them: where
# the part starts, its rows and its columns.
SIZES = 8


class Structure:
    """Two arrays: whole numbers with the parts' places, and the parts.

    A subclass declares sizes and parts, which are numbered in this order, behind those of its base,
    or of ``after``: a structure that has its places in the same table.

    Attributes:
        numbers: (integers,) sizes, places, and whole parts.
        data: (numbers,) all other parts.
        sizes: by name.
        parts: by name.
        numbered: how many parts have a place so far.
    """

    __slots__ = ("data", "numbers")
    sizes: ClassVar[dict[str, Size]] = {}
    parts: ClassVar[dict[str, Place]] = {}
    numbered: ClassVar[int] = 0

    def __init__(self, numbers: Array, data: Array) -> None:
        self.numbers = numbers
        self.data = data

    def __init_subclass__(cls, after: type[Structure] | None = None) -> None:
        cls.sizes, cls.parts = dict(cls.sizes), dict(cls.parts)
        cls.numbered = (after or cls).numbered
        for name, one in list(vars(cls).items()):
            if isinstance(one, Size):
                one.index = len(cls.sizes)
                cls.sizes[name] = one
            elif isinstance(one, Place):
                one.at = SIZES + 3 * cls.numbered
                cls.numbered += 1
                cls.parts[name] = one


def kinds_of(base: type[Kind]) -> Iterator[type[Kind]]:
    """Yield the classes below one that are known so far."""
    for kind in base.__subclasses__():
        yield kind
        yield from kinds_of(kind)


class Size:
    """One of the whole numbers.

    Attributes:
        index: which.
    """

    index = 0

    def __get__(self, structure: Structure, owner: type[Structure]) -> int:
        """Return the number."""
        return int(structure.numbers[self.index])


class Place:
    """Where a part of the data is.

    Args:
        dimensions: 1 for a vector, 2 for a matrix.
        whole: whether it is among the whole numbers themselves.

    Attributes:
        at: index of its place among the whole numbers.
    """

    at = 0

    def __init__(self, dimensions: int, whole: bool = False) -> None:
        self.dimensions = dimensions
        self.whole = whole

    def view(self, structure: Structure) -> Array:
        """Return the part's numbers (n,) or (n, m), not copied."""
        start, rows, columns = structure.numbers[self.at : self.at + 3].tolist()
        data = structure.numbers if self.whole else structure.data
        found = data[start : start + rows * columns]
        return found if self.dimensions == 1 else found.reshape(rows, columns)


class Part(Place):
    """A part that is read as an array."""

    def __get__(self, structure: Structure, owner: type[Structure]) -> Array:
        """Return the view."""
        return self.view(structure)


class RealTail(Part):
    """The last numbers of a part of whole ones, as the float64 numbers that their bits are.

    Args:
        of: the part's name; it is declared before.
    """

    def __init__(self, of: str) -> None:
        super().__init__(1, whole=True)
        self.of = of

    def view(self, structure: Structure) -> Array:
        """Return the numbers (n,), not copied."""
        return super().view(structure).view(np.float64)


class RecordPart(Place, Generic[Kept]):
    """A part that is read as a record.

    Args:
        kind: of record; see :class:`~hapticmech_ros.numerics.layout.Record`.
        whole: whether it is among the whole numbers themselves.
    """

    def __init__(self, kind: Callable[[Array], Kept], whole: bool = False) -> None:
        super().__init__(1, whole)
        self.kind = kind

    def __get__(self, structure: Structure, owner: type[Structure]) -> Kept:
        """Return the record, a view."""
        return self.kind(self.view(structure))


def arrays_of(
    kind: type[Structure], sizes: Mapping[str, int], parts: Mapping[str, Array]
) -> tuple[Array, Array]:
    """Return the two arrays, (integers,) and (numbers,), of a structure whose parts are copies.

    Args:
        kind: of structure.
        sizes: by name; 0 where left out.
        parts: name -> (n,) or (n, m) array; all of them, of a :class:`RealTail` as long a one.
    """
    numbers = np.zeros(SIZES + 3 * len(kind.parts), dtype=np.int64)
    for name, size in sizes.items():
        numbers[kind.sizes[name].index] = size
    whole, real, sized = [numbers], [np.zeros(0)], {True: numbers.size, False: 0}
    for name, place in kind.parts.items():
        given = parts[name]
        columns = given.shape[1] if given.ndim == 2 else 1
        if isinstance(place, RealTail):
            begin, size = numbers[kind.parts[place.of].at :][:2].tolist()
            numbers[place.at : place.at + 3] = begin + size - given.size, given.size, 1
            continue
        numbers[place.at : place.at + 3] = sized[place.whole], len(given), columns
        (whole if place.whole else real).append(given.ravel())
        sized[place.whole] += given.size
    return np.concatenate(whole, dtype=np.int64, casting="unsafe"), np.concatenate(real)
