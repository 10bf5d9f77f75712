"""Structures that kernels hand around: two arrays, and parts of them that are found when asked for.

A kernel's functions would pass each array of a named tuple by itself, seven numbers an array, from
one to the next: for tuples of twenty arrays that takes longer than what many of the functions do.
Inside a kernel a structure is where its two arrays begin, an int64 one and a float64 one, and owns
neither, so that nobody counts who looks at a part of them: whoever calls the kernel holds them
until it returns.
"""

from __future__ import annotations

import importlib
from typing import Any, TypeVar

import numpy as np

from hapticmech_ros.compilation.decorators import uses_numba

Kind = TypeVar("Kind", bound=type)
Array = np.ndarray
# Numbers of a structure that come before the places of its parts; a place is three of them: where
# the part starts, its rows and its columns.
SIZES = 7


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
    """Let kernels make a kind of :class:`Structure`, and ask it for sizes and parts."""
    if uses_numba():
        _teach(kind)
    return kind


def _teach(kind: type) -> None:
    # Numba has no types of its own for what follows.
    core: Any = importlib.import_module("numba.core")
    extending: Any = importlib.import_module("numba.extending")
    templates: Any = importlib.import_module("numba.core.typing.templates")
    cgutils: Any = importlib.import_module("numba.core.cgutils")
    arrays: Any = importlib.import_module("numba.np.arrayobj")
    types = core.types

    class Type(types.Type):  # type: ignore[misc, name-defined]
        def __init__(self) -> None:
            super().__init__(name=kind.__name__)

    class Model(extending.models.StructModel):  # type: ignore[misc]
        def __init__(self, manager: Any, typed: Any) -> None:
            super().__init__(manager, typed, list(members.items()))

    members = {"numbers": types.CPointer(types.int64), "data": types.CPointer(types.float64)}
    extending.register_model(Type)(Model)

    def typing(_context: Any) -> Any:
        def typer(_numbers: Any, _data: Any) -> Any:
            return Type()

        return typer

    def make(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        made = cgutils.create_struct_proxy(signature.return_type)(context, builder)
        starts = []
        for typed, value in zip(signature.args, values, strict=True):
            if isinstance(typed, types.Array):
                starts.append(arrays.make_array(typed)(context, builder, value).data)
            else:
                starts.append(value)
        made.numbers, made.data = starts
        return made._getvalue()

    extending.type_callable(kind)(typing)
    extending.lower_builtin(kind, types.Any, types.Any)(make)

    class Attributes(templates.AttributeTemplate):  # type: ignore[misc]
        key = Type

        def generic_resolve(self, _typed: Any, name: str) -> Any:
            part = getattr(kind, "__dict__", {}).get(name)
            if name in members:
                return members[name]
            if isinstance(part, Size):
                return types.int64
            if isinstance(part, Part):
                return found_type(part)
            return None

    templates.infer_getattr(Attributes)

    def found_type(part: Part) -> Any:
        return types.Array(members["numbers" if part.whole else "data"].dtype, part.dimensions, "C")

    def look(context: Any, builder: Any, typed: Any, value: Any, name: str) -> Any:
        held = cgutils.create_struct_proxy(typed)(context, builder, value)
        if name in members:
            return getattr(held, name)
        part = vars(kind)[name]

        def number(at: int) -> Any:
            place = context.get_constant(types.intp, at)
            return builder.load(builder.gep(held.numbers, [place]))

        if isinstance(part, Size):
            return number(part.index)
        found = arrays.make_array(found_type(part))(context, builder)
        source = held.numbers if part.whole else held.data
        shape = [number(part.at + 1 + k) for k in range(part.dimensions)]
        # Of a float64 as of an int64.
        size = context.get_constant(types.intp, 8)
        strides = [size] if part.dimensions == 1 else [builder.mul(shape[1], size), size]
        arrays.populate_array(
            found,
            data=builder.gep(source, [number(part.at)]),
            shape=shape,
            strides=strides,
            itemsize=size,
            meminfo=None,
        )
        return found._getvalue()

    importlib.import_module("numba.core.imputils").lower_getattr_generic(Type)(look)
