# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Kernels: functions over small arrays that are compiled once and kept on disk.

The calls of NumPy and SciPy that a tick makes cost a microsecond each and compute for a few
nanoseconds. A kernel does a tick's worth of them in one call.

All kernels are compiled together into a library (:mod:`~hapticmech_ros.compilation.library`), which
loads in some milliseconds and without Numba. Rounding is the same in every run: nothing is
reordered, fused or run in parallel.

A kernel does not check the type of an array, nor its strides: its caller passes float64 or int64
arrays, in C order unless the signature states otherwise. A signature may name records and
structures as well (``void(HandMemory, float64, float64[::1])``): the argument is an instance, also
of a subclass, and the machine code finds its arrays. With ``HAPTICMECH_ROS_KERNELS=checked`` in the
environment every call is checked.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from typing import Any, NamedTuple, TypeVar, cast

from hapticmech_ros.compilation.library import function_of

Function = TypeVar("Function", bound=Callable[..., object])


class Kernel(NamedTuple):
    """A function to be compiled.

    Attributes:
        name: in the library.
        signature: types of result and arguments, as Numba writes them.
        function: to compile.
        linked: whether other kernels call it.
        gathered: whether its arguments come in one array of objects.
    """

    name: str
    signature: str
    function: Callable[..., object]
    linked: bool = False
    gathered: bool = False


class _Collection:
    """Kernels found so far, in a process that builds the library."""

    kernels: list[Kernel] | None = None


def collect() -> list[Kernel]:
    """Return a list to which every kernel of modules imported from now on is added, uncompiled."""
    found: list[Kernel] = []
    _Collection.kernels = found
    return found


def is_building() -> bool:
    """Return whether this process builds the library."""
    return _Collection.kernels is not None


def inner(function: Function) -> Function:
    """Return a function that kernels call; compiled as part of each of them."""
    return _translated(function)


def leaf(function: Function) -> Function:
    """Return an :func:`inner` function of a few operations, put into each that calls it."""
    return _translated(function, in_place=True)


def _translated(function: Function, in_place: bool = False) -> Function:
    if not is_building():
        return function
    from hapticmech_ros.compilation.inner_functions import translated

    return cast(Function, translated(function, in_place))


def c_function(name: str, signature: str) -> Callable[..., Any]:
    """Return a function of the C library, for kernels to call.

    Args:
        name: in the C library; one of those that the builder allows.
        signature: types of result and arguments, as Numba writes them.
    """
    if not is_building():
        return cast(Callable[..., Any], getattr(ctypes.CDLL(None), name))
    from hapticmech_ros.compilation.inner_functions import called_in_c

    return cast(Callable[..., Any], called_in_c(name, signature))


def function_at(signature: str) -> Callable[..., Any]:
    """Return a function for kernels that calls a C function by its address.

    Args:
        signature: types of result and arguments, that of the address first, as Numba writes them.
    """
    if not is_building():

        def only_compiled(*_given: Any) -> Any:
            raise NotImplementedError("only kernels call functions by their addresses")

        return only_compiled
    from hapticmech_ros.compilation.inner_functions import called_at

    return cast(Callable[..., Any], called_at(signature))


def kernel(
    signature: str, linked: bool = False, waits: bool = False, gathered: bool = False
) -> Callable[[Function], Function]:
    """Return a decorator that finds a function in the library; other kernels may call it.

    Args:
        signature: types of result and arguments, as Numba writes them, or names of records and
            structures.
        linked: whether other kernels call it by its name in the library: it is translated and
            optimised once, not as a part of each.
        waits: whether other threads run Python meanwhile: it takes longer, or is not to wait for
            them.
        gathered: whether it is called with one array of objects, its arguments in their order. For
            a function of a dozen arrays which is called again and again with the same ones that is
            a microsecond less a call.
    """

    def found(function: Function) -> Function:
        name = _name(function)
        if _Collection.kernels is not None:
            _Collection.kernels.append(Kernel(name, signature, function, linked, gathered))
            if not linked:
                return inner(function)
            from hapticmech_ros.compilation.inner_functions import called_by_name

            return cast(Function, called_by_name(function, name, signature))
        return cast(Function, function_of(name, signature, function, waits, gathered))

    return found


def _name(function: Callable[..., object]) -> str:
    """Return a function's name in the library."""
    module = function.__module__.removeprefix("hapticmech_ros.").replace(".", "_")
    return f"{module}_{function.__name__}"
