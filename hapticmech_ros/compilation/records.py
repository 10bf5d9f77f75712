# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Flat arrays of numbers as named fields, one after the other, for messages and kernels.

A layout is defined once. Offsets of fields, the array's length, a message's labels and the bounds
of numbers follow from it. A record reads and writes the fields of an array by their names, in
Python and in kernels.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import ClassVar, Generic, NamedTuple, TypeVar, overload

import numpy as np
import numpy.typing as npt

Array = np.ndarray
# Of a number that may be anything finite.
ANY = "finite number"


class Field(NamedTuple):
    """Some numbers of a layout.

    Attributes:
        size: how many.
        quantities: of the numbers, repeated; see :mod:`~hapticmech_ros.wire.bounds`.
    """

    size: int
    quantities: tuple[str, ...] = (ANY,)


class Layout(Mapping[str, int]):
    """Fields by name, in order; as a mapping, from each name to its size.

    Args:
        fields: name -> field.

    Attributes:
        fields: these.
        size: of the whole array.
    """

    def __init__(self, fields: Mapping[str, Field]) -> None:
        self.fields = dict(fields)
        self._starts: dict[str, int] = {}
        self.size = 0
        for name, field in self.fields.items():
            self._starts[name] = self.size
            self.size += field.size

    def __getitem__(self, name: str) -> int:
        return self.fields[name].size

    def __iter__(self) -> Iterator[str]:
        return iter(self.fields)

    def __len__(self) -> int:
        return len(self.fields)

    def start(self, name: str) -> int:
        """Return the index of a field's first number."""
        return self._starts[name]

    def slice(self, first: str, last: str = "") -> slice:
        """Return where a field is, or all fields from one to another, both included."""
        end = last or first
        return slice(self._starts[first], self._starts[end] + self.fields[end].size)

    def quantities(self) -> Iterator[str]:
        """Yield each number's quantity."""
        for field in self.fields.values():
            for index in range(field.size):
                yield field.quantities[index % len(field.quantities)]


class Record:
    """An array of float64 (or int64) numbers whose fields have names; kernels read it so as well.

    A subclass declares its fields in order, those of its base first::

        class Spring(Record):
            stiffness = Number()
            rest = Vector(3, "position")

    ``Spring(values).stiffness`` is then ``values[0]``, and ``Spring(values).rest`` a view of the
    next three. In kernels the same lines cost no more than an index.

    Args:
        values: (n,) the numbers, in C order, and maybe others behind them; zero if left out.

    Attributes:
        values: (n,) the numbers.
        layout: where each field is.
        fields: by name.
        dtype: of the numbers.
    """

    __slots__ = ("values",)
    layout: ClassVar[Layout] = Layout({})
    fields: ClassVar[dict[str, RecordField]] = {}
    dtype: ClassVar[type] = float

    def __init__(self, values: Array | None = None) -> None:
        size = self.layout.size
        self.values: Array = np.zeros(size, self.dtype) if values is None else values[:size]

    def __init_subclass__(cls) -> None:
        own = {name: one for name, one in vars(cls).items() if isinstance(one, RecordField)}
        cls.fields = {**cls.fields, **own}
        at = cls.layout.size
        for field in own.values():
            field.at = at
            at += field.size
        parts: dict[str, Field] = {}
        for name, field in cls.fields.items():
            if isinstance(field, Nested) and field.flat:
                parts.update(field.kind.layout.fields)
            else:
                parts[name] = Field(field.size, field.quantities)
        cls.layout = Layout(parts)

    def fill(self, **fields: npt.ArrayLike) -> None:
        """Write fields, each by its name."""
        for name, value in fields.items():
            self.fields[name].__set__(self, value)


class RecordField:
    """A field of a record.

    Attributes:
        at: index of its first number.
        size: how many it has.
        quantities: of the numbers, repeated.
    """

    def __init__(self, size: int, quantities: tuple[str, ...]) -> None:
        self.size = size
        self.quantities = quantities
        self.at = 0

    def __set__(self, record: Record, value: npt.ArrayLike) -> None:
        """Write all numbers of the field: as many as it has."""
        record.values[self.at : self.at + self.size] = np.reshape(value, self.size)


Read = TypeVar("Read", float, int, bool)


class Scalar(RecordField, Generic[Read]):
    """One number.

    Args:
        quantity: of the number.

    Attributes:
        read: its type in Python; kernels read the number.
    """

    read: type[Read]

    def __init__(self, quantity: str = ANY) -> None:
        super().__init__(1, (quantity,))

    @overload
    def __get__(self, record: None, owner: type[Record]) -> Scalar[Read]: ...
    @overload
    def __get__(self, record: Record, owner: type[Record]) -> Read: ...
    def __get__(self, record: Record | None, owner: type[Record]) -> Scalar[Read] | Read:
        """Return the number."""
        return self if record is None else self.read(record.values.item(self.at))

    def __set__(self, record: Record, value: float) -> None:  # type: ignore[override]
        """Write the number."""
        record.values[self.at] = value


class Number(Scalar[float]):
    """One number, read as a float."""

    read = float


class Whole(Scalar[int]):
    """One whole number."""

    read = int


class Flag(Scalar[bool]):
    """One number that is 0 or 1, read as a bool."""

    read = bool

    def __init__(self) -> None:
        super().__init__("flags")


class Vector(RecordField):
    """A view of some numbers; of rows and columns, a matrix.

    Args:
        size: how many.
        quantities: of the numbers, repeated.
        columns: of a matrix, which is stored row by row; 0 for a vector.
    """

    def __init__(
        self, size: int, quantities: str | tuple[str, ...] = ANY, columns: int = 0
    ) -> None:
        named = (quantities,) if isinstance(quantities, str) else quantities
        super().__init__(size, named)
        self.shape = (size // columns, columns) if columns else (size,)

    @overload
    def __get__(self, record: None, owner: type[Record]) -> Vector: ...
    @overload
    def __get__(self, record: Record, owner: type[Record]) -> Array: ...
    def __get__(self, record: Record | None, owner: type[Record]) -> Vector | Array:
        """Return the view."""
        if record is None:
            return self
        found = record.values[self.at : self.at + self.size]
        return found if len(self.shape) == 1 else found.reshape(self.shape)


def matrix(rows: int, columns: int, quantities: str | tuple[str, ...] = ANY) -> Vector:
    """Return a field that is read as a matrix, stored row by row."""
    return Vector(rows * columns, quantities, columns)


Inside = TypeVar("Inside", bound=Record)


class Nested(RecordField, Generic[Inside]):
    """A record in a record.

    Args:
        kind: of the record inside.
        flat: whether the layout names its fields one by one.
    """

    def __init__(self, kind: type[Inside], flat: bool = False) -> None:
        super().__init__(kind.layout.size, tuple(kind.layout.quantities()))
        self.kind = kind
        self.flat = flat

    @overload
    def __get__(self, record: None, owner: type[Record]) -> Nested[Inside]: ...
    @overload
    def __get__(self, record: Record, owner: type[Record]) -> Inside: ...
    def __get__(self, record: Record | None, owner: type[Record]) -> Nested[Inside] | Inside:
        """Return the record inside, a view."""
        if record is None:
            return self
        return self.kind(record.values[self.at : self.at + self.size])
