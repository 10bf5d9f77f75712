"""Functions that kernels call, each translated once for the types it is called with.

Numba alone would put a copy of every function, and of all that this calls, into each that calls
it, optimise that copy and make machine code of it, which nobody runs: time grows with the square
of a kernel's depth. Here a call is a call of a name, a function's module is what it does itself,
and a kernel's modules are joined before LLVM optimises them, once and together.

Only the processes that build the library import this. It uses what Numba documents: functions in
the intermediate language of LLVM (``inspect_llvm``), and calls that extensions write themselves
(``numba.extending.intrinsic``).
"""

from __future__ import annotations

import importlib
import inspect
import re
from collections.abc import Callable
from typing import Any, NamedTuple

import llvmlite.binding as llvm

# Division by zero gives what NumPy gives; no operation is reordered or fused.
OPTIONS: dict[str, Any] = {"error_model": "numpy", "fastmath": False}
# Which have no types of their own.
numba: Any = importlib.import_module("numba")
extending: Any = importlib.import_module("numba.extending")
ir: Any = importlib.import_module("llvmlite.ir")
# Who counts who looks at an array: nobody has to, since nobody owns one.
_COUNTING = re.compile(r"^ *(?:tail )?call void @NRT_(?:in|de)cref\(.*\n", re.MULTILINE)
# What may be called from C is kept apart from what it calls, for debuggers.
_APART = re.compile(r"^(attributes #\d+ = \{.*)\bnoinline\b", re.MULTILINE)
_CALLABLE = re.compile(r"^define [^@]*@(cfunc\.[^( ]+)\(", re.MULTILINE)
_DECLARED = re.compile(r"^declare [^@]*@(cfunc\.[^( ]+)\(", re.MULTILINE)


class _Part(NamedTuple):
    """A translated function: its own module, and the names of those that it calls."""

    module: bytes
    calls: list[str]


# Translated so far in this process, by the names they are called by.
_parts: dict[str, _Part] = {}


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

        def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
            returned = context.get_value_type(signature.return_type)
            kind = ir.FunctionType(returned, [value.type for value in values])
            known = builder.module.globals
            called = known[name] if name in known else ir.Function(builder.module, kind, name)
            return builder.call(called, values)

        return result.return_type(*kinds), generate

    context = inspect.Parameter("_context", inspect.Parameter.POSITIONAL_ONLY)
    call.__name__ = function.__name__
    call.__signature__ = parameters.replace(  # type: ignore[attr-defined]
        parameters=[context, *parameters.parameters.values()]
    )
    return extending.intrinsic(call)


def joined(code: str, name: str) -> bytes:
    """Return a module of LLVM, as bitcode: a function that C may call, and all that it calls.

    Args:
        code: of the function, in LLVM's intermediate language.
        name: that others find it by; nothing else in the module can be seen from outside.
    """
    (own,) = _CALLABLE.findall(code)
    module = llvm.parse_assembly(_plain(code).replace(own, name))
    waiting, linked = _called(code), set()
    while waiting:
        one = waiting.pop()
        if one not in linked:
            linked.add(one)
            part = _parts[one]
            module.link_in(llvm.parse_bitcode(part.module))
            waiting += part.calls
    for function in module.functions:
        if not function.is_declaration and function.name != name:
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
    """Leave out what is seen at once to be superfluous, once for all kernels that call it."""
    llvm.initialize_native_target()
    options = llvm.create_pipeline_tuning_options(speed_level=1)
    options.loop_vectorization = options.loop_unrolling = options.slp_vectorization = False
    machine = llvm.Target.from_default_triple().create_target_machine()
    builder = llvm.create_pass_builder(machine, options)
    builder.getModulePassManager().run(module, builder)


def _plain(code: str) -> str:
    return _APART.sub(r"\1nounwind", _COUNTING.sub("", code))
