# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Room for kernels to work in, and other shapes of the same numbers.

These are plain NumPy, for uncompiled calls of kernels' functions; for compiled kernels
:mod:`~hapticmech_ros.compilation.numba_types` replaces them: no kernel allocates memory.
"""

from __future__ import annotations

import numpy as np

Array = np.ndarray


def local(size: int) -> Array:
    """Return room for so many numbers (size,), which is valid until the calling function returns.

    It is on the stack: not for more than some thousands, and in a loop with a number that is
    written out only.
    """
    return np.empty(size)


def local_whole(size: int) -> Array:
    """Return room for whole numbers (size,); see :func:`local`."""
    return np.empty(size, dtype=np.int64)


def shaped(numbers: Array, shape: tuple[int, ...]) -> Array:
    """Return the first numbers of an array (n,) in C order as a view of another shape.

    Args:
        numbers: (n,) or more dimensions, contiguous.
        shape: of the view; its size is n at most.
    """
    return numbers.ravel()[: int(np.prod(shape))].reshape(shape)


def put(target: Array, source: Array) -> None:
    """Copy an array (n,) or (n, m) into another one of the same size.

    Args:
        target: (n,) or (n, m) to fill.
        source: (n,) or (n, m).
    """
    target[:] = source
