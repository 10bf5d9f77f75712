"""Kernels: functions over small arrays that Numba compiles once and keeps on disk.

The calls of NumPy and SciPy that a tick makes cost a microsecond each and compute for a few
nanoseconds. A kernel does a tick's worth of them in one call. Every kernel has an implementation
in plain NumPy beside it, which says what it computes and is what tests compare it with.

All kernels are compiled together into a library (:mod:`~hapticmech_ros.compilation.library`), which
loads in a millisecond and without Numba. Where that cannot be built, or where the environment says
``HAPTICMECH_ROS_KERNELS=jit``, each process compiles its own with Numba, or loads what another one
compiled, which takes it a second. Rounding is the same in every run: nothing is reordered, fused or
run in parallel.

A kernel in the library does not look at the type of an array, nor at its strides: whoever calls it
gives it float64 or int64 arrays of its own, in C order unless the signature says otherwise.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple, TypeVar, cast

from hapticmech_ros.compilation.cache import folder
from hapticmech_ros.compilation.custody import is_safe
from hapticmech_ros.compilation.kept import keep
from hapticmech_ros.compilation.library import library

Function = TypeVar("Function", bound=Callable[..., object])
# Division by zero gives what NumPy gives; no operation is reordered or fused.
OPTIONS: dict[str, Any] = {"error_model": "numpy", "fastmath": False}


class Kernel(NamedTuple):
    """A function to be compiled for these argument types, and its name in the library."""

    name: str
    signature: str
    function: Callable[..., object]


class _Collection:
    """Kernels found so far, where they are collected in order to be compiled together."""

    kernels: list[Kernel] | None = None


def collect() -> list[Kernel]:
    """Return a list to which every kernel of modules imported from now on is added, uncompiled."""
    found: list[Kernel] = []
    _Collection.kernels = found
    return found


def uses_numba() -> bool:
    """Return whether functions are compiled by this process: there is no library of them."""
    return _Collection.kernels is not None or library() is None


def inner(function: Function) -> Function:
    """Return a function that kernels call; compiled as part of each of them."""
    if not uses_numba():
        return function
    import numba

    return cast(Function, numba.njit(**OPTIONS)(function))


def leaf(function: Function) -> Function:
    """Return an :func:`inner` function of a few operations, put into each that calls it."""
    if not uses_numba():
        return function
    import numba

    return cast(Function, numba.njit(forceinline=True, **OPTIONS)(function))


def kernel(signature: str) -> Callable[[Function], Function]:
    """Return a decorator that finds a function in the library, or else compiles or loads it."""

    def compiled(function: Function) -> Function:
        module = function.__module__.removeprefix("hapticmech_ros.").replace(".", "_")
        name = f"{module}_{function.__name__}"
        if _Collection.kernels is not None:
            _Collection.kernels.append(Kernel(name, signature, function))
            return function
        found = getattr(library(), name, None)
        return _just_in_time(signature, function) if found is None else cast(Function, found)

    return compiled


def _just_in_time(signature: str, function: Function) -> Function:
    """Compile a function or load it; where no folder can be used, compile it each time."""
    import numba

    dispatcher: Any = numba.njit(**OPTIONS)(function)
    try:
        place = folder()
        if is_safe(place):
            with _cache_folder(numba.config, place):
                keep(dispatcher)
    except (OSError, RuntimeError):
        pass
    dispatcher.compile(signature)
    dispatcher.disable_compile()
    return cast(Function, dispatcher)


@contextmanager
def _cache_folder(config: Any, place: Path) -> Iterator[None]:
    before = config.CACHE_DIR
    config.CACHE_DIR = str(place)
    try:
        yield
    finally:
        config.CACHE_DIR = before
