# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Functions that kernels call, each translated once for the types it is called with.

Numba alone would put a copy of every function, with all its callees, into each of its callers, and
would optimise and compile that unused copy: time grows with the square of a kernel's depth. Here a
call refers to a name, a function's module has only its own code, and a kernel's modules are joined
before LLVM optimises them, once and together.

Only the processes that build the library import this. It uses Numba's documented interfaces:
functions in the intermediate language of LLVM (``inspect_llvm``), and calls that extensions write
themselves (``numba.extending.intrinsic``).
"""

from __future__ import annotations

import functools
import importlib
import inspect
import re
from collections.abc import Callable
from typing import Any, NamedTuple

import llvmlite.binding as llvm

# Division by zero gives NumPy's result; no operation is reordered or fused.
OPTIONS: dict[str, Any] = {"error_model": "numpy", "fastmath": False}
# How the name ends by which kernels call a linked kernel: its arrays are not NumPy's objects there.
LINKED = ".linked"
# Which have no types of their own.
numba: Any = importlib.import_module("numba")
extending: Any = importlib.import_module("numba.extending")
ir: Any = importlib.import_module("llvmlite.ir")
# Types by the names that signatures have: Numba's own, and records and structures once they are
# known.
TYPES: dict[str, Any] = {**vars(numba.types), "Array": numba.types.Array}
# Reference counting of arrays, which is unnecessary: kernels own none.
_COUNTING = re.compile(r"^ *(?:tail )?call void @NRT_(?:in|de)cref\(.*\n", re.MULTILINE)
# Numba keeps functions callable from C apart from their callees, for debuggers.
_APART = re.compile(r"^(attributes #\d+ = \{.*)\bnoinline\b", re.MULTILINE)
_CALLABLE = re.compile(r"^define [^@]*@(cfunc\.[^( ]+)\(", re.MULTILINE)
_DECLARED = re.compile(r"^declare [^@]*@(cfunc\.[^( ]+)\(", re.MULTILINE)


class _Part(NamedTuple):
    """A translated function: its own module, and the names of those that it calls."""

    module: bytes
    calls: list[str]


# Translated so far in this process, by the names they are called by.
_parts: dict[str, _Part] = {}
# Names of a function's translations, one for each combination of types.
_names: dict[Callable[..., Any], set[str]] = {}


@functools.cache
def translated(function: Callable[..., Any], in_place: bool = False) -> Any:
    """Return a function that others which Numba translates can call.

    Args:
        function: for each combination of argument types translated when first called.
        in_place: whether LLVM must put it into each that calls it; otherwise that is its choice.
    """
    dispatcher = numba.njit(**OPTIONS, no_cpython_wrapper=True)(function)
    parameters = inspect.signature(function)

    def call(_context: Any, *given: Any, **named: Any) -> Any:
        kinds = parameters.bind(*given, **named).args
        dispatcher.compile(kinds)
        (result,) = (one for one in dispatcher.nopython_signatures if one.args == kinds)
        name = _keep(dispatcher.inspect_llvm(kinds), in_place)

        _names.setdefault(function, set()).add(name)
        return result.return_type(*kinds), _call_of(name)

    return _intrinsic(call, function.__name__, parameters)


def _call_of(name: str) -> Callable[..., Any]:
    """Return a generator of a call of a function by its name."""

    def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        returned = context.get_value_type(signature.return_type)
        kind = ir.FunctionType(returned, [value.type for value in values])
        known = builder.module.globals
        called = known[name] if name in known else ir.Function(builder.module, kind, name)
        return builder.call(called, values)

    return generate


def _intrinsic(call: Any, name: str, parameters: inspect.Signature) -> Any:
    context = inspect.Parameter("_context", inspect.Parameter.POSITIONAL_ONLY)
    call.__name__ = name
    call.__signature__ = parameters.replace(parameters=[context, *parameters.parameters.values()])
    return extending.intrinsic(call)


def called_by_name(function: Callable[..., Any], name: str, signature: str) -> Any:
    """Return a linked kernel as a function that other kernels can call.

    Args:
        function: the kernel's.
        name: its name in the library.
        signature: types of result and arguments.
    """
    parameters = inspect.signature(function)
    # Numba needs an address of every called function, though none runs here.
    llvm.add_symbol(name + LINKED, 1)

    def call(_context: Any, *given: Any, **named: Any) -> Any:
        parameters.bind(*given, **named)
        # Not before: records and structures have to be known.
        return signature_of(signature), _call_of(name + LINKED)

    return _intrinsic(call, function.__name__, parameters)


def called_in_c(name: str, signature: str) -> Any:
    """Return a function of the C library as one that kernels can call.

    Args:
        name: in the C library.
        signature: types of result and arguments.
    """
    types = signature_of(signature)
    names = (f"a{number}" for number in range(len(types.args)))
    kind = inspect.Parameter.POSITIONAL_OR_KEYWORD
    parameters = inspect.Signature([inspect.Parameter(one, kind) for one in names])

    def call(_context: Any, *given: Any, **named: Any) -> Any:
        parameters.bind(*given, **named)
        return types, _call_of(name)

    return _intrinsic(call, name, parameters)


def called_at(signature: str) -> Any:
    """Return a function for kernels that calls another by its address.

    Args:
        signature: types of result and arguments, that of the address first.
    """
    types = signature_of(signature)
    kind = inspect.Parameter.POSITIONAL_OR_KEYWORD
    names = (f"a{number}" for number in range(len(types.args)))

    def call(_context: Any, *_given: Any, **_named: Any) -> Any:
        return types, _call_at

    return _intrinsic(
        call, "called_at", inspect.Signature([inspect.Parameter(one, kind) for one in names])
    )


def _call_at(context: Any, builder: Any, signature: Any, values: Any) -> Any:
    """Write a call of the function whose address is the first value."""
    address, *given = values
    kind = ir.FunctionType(
        context.get_value_type(signature.return_type), [value.type for value in given]
    )
    return builder.call(builder.inttoptr(address, kind.as_pointer()), given)


def signature_of(text: str) -> Any:
    """Return a signature as Numba has it."""
    return eval(text, TYPES)


def joined(code: str, name: str, linked: Callable[..., Any] | None = None) -> bytes:
    """Return a module of LLVM, as bitcode: a function that C may call, and all that it calls.

    Args:
        code: of the function, in LLVM's intermediate language.
        name: that others find it by; nothing else in the module can be seen from outside.
        linked: of the functions that it calls the one that other kernels call too.
    """
    (own,) = ("",) if linked is None else _names[linked]
    (entry,) = _CALLABLE.findall(code)
    module = llvm.parse_assembly(_plain(code).replace(entry, name))
    waiting, known = _called(code), set()
    while waiting:
        one = waiting.pop()
        if one not in known:
            known.add(one)
            part = _parts[one]
            module.link_in(llvm.parse_bitcode(part.module))
            waiting += part.calls
    for function in module.functions:
        if function.name == own:
            function.name = name + LINKED
            function.linkage = "external"
        elif not function.is_declaration and function.name != name:
            function.linkage = "internal"
    return bytes(module.as_bitcode())


def _called(code: str) -> list[str]:
    return [one for one in _DECLARED.findall(code) if one in _parts]


def _keep(code: str, in_place: bool) -> str:
    """Keep a translated function until kernels need it, and return the name to call it by."""
    name = str(*_CALLABLE.findall(code))
    if name not in _parts:
        module = llvm.parse_assembly(_plain(code))
        # The body, which the function that C may call goes into.
        module.get_function(name.removeprefix("cfunc.")).add_function_attribute("alwaysinline")
        if in_place:
            module.get_function(name).add_function_attribute("alwaysinline")
        _shorten(module)
        _parts[name] = _Part(module.as_bitcode(), _called(code))
    return name


def _shorten(module: Any) -> None:
    """Remove obviously superfluous code, once for all kernels that call it."""
    llvm.initialize_native_target()
    options = llvm.create_pipeline_tuning_options(speed_level=1)
    options.loop_vectorization = options.loop_unrolling = options.slp_vectorization = False
    machine = llvm.Target.from_default_triple().create_target_machine()
    builder = llvm.create_pass_builder(machine, options)
    builder.getModulePassManager().run(module, builder)


def _plain(code: str) -> str:
    return _APART.sub(r"\1nounwind", _COUNTING.sub("", code))
