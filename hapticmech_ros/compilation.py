"""Kernels: functions over small arrays that Numba compiles once and keeps on disk.

The calls of NumPy and SciPy that a tick makes cost a microsecond each and compute for a few
nanoseconds. A kernel does a tick's worth of them in one call. Every kernel has an implementation
in plain NumPy beside it, which says what it computes and is what tests compare it with.

What is compiled is kept in the user's cache folder (``NUMBA_CACHE_DIR``, or ``hapticmech_ros`` in
``XDG_CACHE_HOME``; see :mod:`~hapticmech_ros.kernel_cache`). Rounding is the same in every run:
nothing is reordered, fused or run in parallel.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any, TypeVar, cast

import numba

from hapticmech_ros.kernel_cache import folder

Function = TypeVar("Function", bound=Callable[..., object])
# Division by zero gives what NumPy gives; no operation is reordered or fused.
_OPTIONS: dict[str, Any] = {"error_model": "numpy", "fastmath": False}


def inner(function: Function) -> Function:
    """Return a function that kernels call; compiled as part of each of them."""
    return cast(Function, numba.njit(**_OPTIONS)(function))


def kernel(signature: str) -> Callable[[Function], Function]:
    """Return a decorator that compiles a function for these argument types, or loads it.

    Where no folder can be written, every process compiles for itself, which takes seconds.
    """

    def compile_or_load(function: Function) -> Function:
        try:
            with _cache_folder():
                return cast(Function, numba.njit(signature, cache=True, **_OPTIONS)(function))
        except (OSError, RuntimeError):
            return cast(Function, numba.njit(signature, **_OPTIONS)(function))

    return compile_or_load


@contextmanager
def _cache_folder() -> Iterator[None]:
    config: Any = numba.config
    before = config.CACHE_DIR
    config.CACHE_DIR = str(folder(before))
    try:
        yield
    finally:
        config.CACHE_DIR = before
