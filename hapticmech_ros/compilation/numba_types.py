# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Extensions of Numba to compile kernels: structures, room on the stack, arrays of callers.

Only the processes that build the library import this. It uses Numba's documented interface for
extensions (``numba.extending``) and its builder of LLVM instructions.
"""

from __future__ import annotations

import functools
import importlib
from collections.abc import Callable
from typing import Any

from hapticmech_ros.compilation import arrays
from hapticmech_ros.compilation.inner_functions import TYPES, translated
from hapticmech_ros.compilation.library import DATA_AT, SHAPE_AT, SLOTS_AT
from hapticmech_ros.compilation.records import Nested, Record, Vector
from hapticmech_ros.compilation.structures import Place, RealTail, RecordPart, Structure

# Which have no types of their own.
numba: Any = importlib.import_module("numba")
extending: Any = importlib.import_module("numba.extending")
templates: Any = importlib.import_module("numba.core.typing.templates")
cgutils: Any = importlib.import_module("numba.core.cgutils")
arrayobj: Any = importlib.import_module("numba.np.arrayobj")
ir: Any = importlib.import_module("llvmlite.ir")
numba_ir: Any = importlib.import_module("numba.core.ir")
ir_utils: Any = importlib.import_module("numba.core.ir_utils")
types, carray, farray = numba.types, numba.carray, numba.farray
_NUMBERS, _WHOLE = types.CPointer(types.float64), types.CPointer(types.int64)
_WORD = ir.IntType(64)


def _keep_writes(
    made: Any, _args: Any, _types: Any, _function: Any, _aliases: Any, of_arguments: set[str]
) -> None:
    """Declare that every result of a function may be a view of its arguments.

    Numba does not know this of fields of records and of unpacked tuples, and would remove writes to
    a view that is not read afterwards.
    """
    of_arguments.add(made.target.name)


ir_utils.alias_analysis_extensions[numba_ir.Assign] = _keep_writes


def _shift(_context: Any, pointer: Any, _count: Any) -> Any:
    """Return a pointer so many numbers further on."""

    def generate(_context: Any, builder: Any, _signature: Any, arguments: Any) -> Any:
        return builder.gep(arguments[0], [arguments[1]])

    return pointer(pointer, types.int64), generate


def _as_real(_context: Any, pointer: Any) -> Any:
    """Return a pointer to the float64 numbers that whole ones are by their bits."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        return builder.bitcast(arguments[0], context.get_value_type(signature.return_type))

    return _NUMBERS(pointer), generate


def _find_start(_context: Any, array: Any) -> Any:
    """Return the pointer to an array's first number."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        return _start(context, builder, signature.args[0], arguments[0])

    return types.CPointer(array.dtype)(array), generate


def _start(context: Any, builder: Any, typed: Any, value: Any) -> Any:
    """Return the pointer to an array's first number; a pointer as it is."""
    if isinstance(typed, types.Array):
        return context.make_array(typed)(context, builder, value).data
    return value


def _room(dtype: Any) -> Any:
    """Return an intrinsic that reserves numbers of a type on the stack of the function it is in."""

    def reserve(_context: Any, size: Any) -> Any:
        written_out = isinstance(size, types.IntegerLiteral)

        def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
            kind = context.get_data_type(dtype)
            if not written_out:
                return builder.alloca(kind, size=arguments[0])
            # Once, outside any loop.
            with builder.goto_entry_block():
                count = ir.Constant(_WORD, signature.args[0].literal_value)
                return builder.alloca(kind, size=count)

        return types.CPointer(dtype)(size), generate

    return extending.intrinsic(prefer_literal=True)(reserve)


_shifted, _start_of = extending.intrinsic(_shift), extending.intrinsic(_find_start)
_real = extending.intrinsic(_as_real)
_numbers_on_stack, _whole_on_stack = _room(types.float64), _room(types.int64)


def _local(size: Any) -> Any:
    return lambda size: carray(_numbers_on_stack(size), (size,))


def _local_whole(size: Any) -> Any:
    return lambda size: carray(_whole_on_stack(size), (size,))


def _shaped(numbers: Any, shape: Any) -> Any:
    return lambda numbers, shape: carray(_start_of(numbers), shape)


def _put(target: Any, source: Any) -> Any:
    def copy(target, source):  # type: ignore[no-untyped-def]
        for i in range(target.size):
            target[i] = source[i]

    def copy_rows(target, source):  # type: ignore[no-untyped-def]
        for i in range(target.shape[0]):
            for j in range(target.shape[1]):
                target[i, j] = source[i, j]

    return copy if target.ndim == 1 else copy_rows


# Into the function that asks, whose stack it is.
_IN_PLACE: dict[str, Any] = {"inline": "always", "prefer_literal": True, "strict": False}
extending.overload(arrays.local, **_IN_PLACE)(_local)
extending.overload(arrays.local_whole, **_IN_PLACE)(_local_whole)
extending.overload(arrays.shaped, inline="always", strict=False)(_shaped)
extending.overload(arrays.put, strict=False)(_put)


def teach_structure(kind: type[Structure]) -> None:
    """Let kernels make a kind of structure of two arrays, and ask it for sizes and parts."""
    members = {"numbers": _WHOLE, "data": _NUMBERS}

    class StructureType(types.Type):  # type: ignore[misc, name-defined]
        def __init__(self) -> None:
            self.kind = kind
            super().__init__(name=kind.__name__)

    class Model(extending.models.StructModel):  # type: ignore[misc]
        def __init__(self, manager: Any, typed: Any) -> None:
            super().__init__(manager, typed, list(members.items()))

    extending.register_model(StructureType)(Model)
    TYPES[kind.__name__] = made = StructureType()

    def construct(_context: Any) -> Any:
        return lambda numbers, data: made

    def make(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        held = ir.Constant(context.get_value_type(signature.return_type), ir.Undefined)
        for index, (typed, value) in enumerate(zip(signature.args, values, strict=True)):
            start = _start(context, builder, typed, value)
            held = builder.insert_value(held, start, index)
        return held

    extending.type_callable(kind)(construct)
    extending.lower_builtin(kind, types.Any, types.Any)(make)
    for name in members:
        extending.make_attribute_wrapper(StructureType, name, name)
    for name, size in kind.sizes.items():
        extending.overload_attribute(StructureType, name)(_size_getter(size.index))
    for name, part in kind.parts.items():
        extending.overload_attribute(StructureType, name)(_part_getter(part))


def _size_getter(index: int) -> Callable[[Any], Any]:
    def get(held):  # type: ignore[no-untyped-def]
        return lambda held: held.numbers[index]

    return get


_numbers_of = extending.register_jitable(lambda held: held.numbers)
_data_of = extending.register_jitable(lambda held: held.data)


def _part_getter(part: Place) -> Callable[[Any], Any]:
    at, rows, columns = part.at, part.at + 1, part.at + 2
    whole: Any = _numbers_of if part.whole else _data_of
    kind: Any = part.kind if isinstance(part, RecordPart) else None

    def record(held):  # type: ignore[no-untyped-def]
        return lambda held: kind(_shifted(whole(held), held.numbers[at]))

    def vector(held):  # type: ignore[no-untyped-def]
        return lambda held: carray(_shifted(whole(held), held.numbers[at]), (held.numbers[rows],))

    def matrix(held):  # type: ignore[no-untyped-def]
        return lambda held: carray(
            _shifted(whole(held), held.numbers[at]), (held.numbers[rows], held.numbers[columns])
        )

    def tail(held):  # type: ignore[no-untyped-def]
        return lambda held: carray(
            _real(_shifted(held.numbers, held.numbers[at])), (held.numbers[rows],)
        )

    if kind is not None:
        return record
    if isinstance(part, RealTail):
        return tail
    return vector if part.dimensions == 1 else matrix


class RecordType(types.Type):  # type: ignore[misc, name-defined]
    """A record: where its first number is.

    Args:
        kind: of record.
    """

    def __init__(self, kind: type[Record]) -> None:
        self.kind = kind
        self.number = types.int64 if kind.dtype is int else types.float64
        super().__init__(name=f"{kind.__module__}.{kind.__qualname__}")


@extending.register_model(RecordType)
class _RecordModel(extending.models.StructModel):  # type: ignore[misc]
    def __init__(self, manager: Any, typed: RecordType) -> None:
        super().__init__(manager, typed, [("start", types.CPointer(typed.number))])


@extending.infer_getattr
class _RecordFields(templates.AttributeTemplate):  # type: ignore[misc]
    key = RecordType

    def generic_resolve(self, record: RecordType, name: str) -> Any:
        """Return the type of a field."""
        field = record.kind.fields.get(name)
        if isinstance(field, Nested):
            return RecordType(field.kind)
        if isinstance(field, Vector):
            return types.Array(record.number, len(field.shape), "C")
        if name == "values":
            return types.Array(record.number, 1, "C")
        return None if field is None else record.number


def _read_field(context: Any, builder: Any, record: RecordType, value: Any, name: str) -> Any:
    if name == "values":
        size = record.kind.layout.size
        return _array(context, builder, record.number, builder.extract_value(value, 0), (size,))
    field, found = record.kind.fields[name], _field_at(builder, record, value, name)
    if isinstance(field, Nested):
        return _record_at(context, builder, RecordType(field.kind), found)
    if isinstance(field, Vector):
        return _array(context, builder, record.number, found, field.shape)
    return builder.load(found)


def _write_field(context: Any, builder: Any, signature: Any, given: Any, name: str) -> None:
    record, kind = signature.args
    value = context.cast(builder, given[1], kind, record.number)
    builder.store(value, _field_at(builder, record, given[0], name))


def _field_at(builder: Any, record: RecordType, value: Any, name: str) -> Any:
    first, at = builder.extract_value(value, 0), record.kind.fields[name].at
    return builder.gep(first, [ir.Constant(_WORD, at)])


def _record_at(context: Any, builder: Any, record: RecordType, start: Any) -> Any:
    held = ir.Constant(context.get_value_type(record), ir.Undefined)
    return builder.insert_value(held, start, 0)


extending.lower_getattr_generic(RecordType)(_read_field)
extending.lower_setattr_generic(RecordType)(_write_field)


def teach_record(kind: type[Record]) -> None:
    """Let kernels make a record of an array's numbers, or one of its own, zero, on the stack."""
    TYPES[kind.__name__] = made = RecordType(kind)

    def construct(_context: Any) -> Any:
        return lambda values=None: made

    def make(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        start = _start(context, builder, signature.args[0], values[0])
        return _record_at(context, builder, made, start)

    def make_own(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        number, size = context.get_data_type(made.number), kind.layout.size
        # Once, outside any loop.
        with builder.goto_entry_block():
            start = builder.alloca(number, size=ir.Constant(_WORD, size))
        cgutils.memset(builder, start, ir.Constant(_WORD, 8 * size), 0)
        return _record_at(context, builder, made, start)

    extending.type_callable(kind)(construct)
    extending.lower_builtin(kind, types.Any)(make)
    extending.lower_builtin(kind)(make_own)


def _array(context: Any, builder: Any, dtype: Any, start: Any, shape: tuple[int, ...]) -> Any:
    """Return an array in C order that begins at a pointer, without an owner."""
    array = context.make_array(types.Array(dtype, len(shape), "C"))(context, builder)
    size = context.get_abi_sizeof(context.get_data_type(dtype))
    strides = [size] if len(shape) == 1 else [size * shape[1], size]
    arrayobj.populate_array(
        array,
        data=builder.bitcast(start, array.data.type),
        shape=[ir.Constant(_WORD, one) for one in shape],
        strides=[ir.Constant(_WORD, one) for one in strides],
        itemsize=ir.Constant(_WORD, size),
        meminfo=None,
    )
    return array._getvalue()


@functools.cache
def argument_of(typed: Any) -> Any:
    """Return a function that finds an argument of a type in NumPy's or Python's object of it.

    That is of an array, record or structure, by the object's address.
    """
    if isinstance(typed, RecordType):
        kind, values = typed.kind, _reader(types.CPointer(typed.number), SLOTS_AT, DATA_AT)
        return translated(lambda address: kind(values(address)))
    if not isinstance(typed, types.Array):
        made, data = typed.kind, _reader(_NUMBERS, SLOTS_AT, DATA_AT)
        numbers = _reader(_WHOLE, SLOTS_AT + 8, DATA_AT)
        return translated(lambda address: made(numbers(address), data(address)))
    start = _reader(types.CPointer(typed.dtype), DATA_AT)
    sizes = [_reader(types.int64, SHAPE_AT, 8 * index) for index in range(typed.ndim)]
    if typed.ndim == 1:
        (n,) = sizes
        return translated(lambda address: carray(start(address), (n(address),)))
    n, m = sizes
    make = farray if typed.layout == "F" else carray
    return translated(lambda address: make(start(address), (n(address), m(address))))


def object_at(index: int) -> Any:
    """Return a function that finds an object's address in NumPy's array of objects, by its own."""
    return _reader(types.int64, DATA_AT, 8 * index)


def _reader(kind: Any, *places: int) -> Any:
    """Return an intrinsic that reads a word of an object, or through its pointers.

    Args:
        kind: of the word, a whole number or a pointer.
        places: offset of the word in the object, bytes, then of one at that pointer, and so on.
    """

    def read(_context: Any, _address: Any) -> Any:
        def generate(context: Any, builder: Any, _signature: Any, arguments: Any) -> Any:
            found = arguments[0]
            for place in places:
                at = builder.add(found, ir.Constant(_WORD, place))
                found = builder.load(builder.inttoptr(at, _WORD.as_pointer()))
            whole = kind == types.int64
            return found if whole else builder.inttoptr(found, context.get_value_type(kind))

        return kind(types.int64), generate

    return extending.intrinsic(read)
