# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""SciPy's BLAS and LAPACK, loaded when the first of them is called.

That takes a third of a second, which a node that starts again does not have, and kernels never call
them.
"""

from __future__ import annotations

from functools import cache
from typing import Any


def dtrsm(*arguments: Any, **options: Any) -> Any:
    """Return the solution of a triangular system for a matrix; see ``scipy.linalg.blas.dtrsm``."""
    return _blas().dtrsm(*arguments, **options)


def dtrsv(*arguments: Any, **options: Any) -> Any:
    """Return the solution of a triangular system for a vector; see ``scipy.linalg.blas.dtrsv``."""
    return _blas().dtrsv(*arguments, **options)


def dpotrf(*arguments: Any, **options: Any) -> Any:
    """Return the factor of a positive definite matrix; see ``scipy.linalg.lapack.dpotrf``."""
    return _lapack().dpotrf(*arguments, **options)


@cache
def _blas() -> Any:
    from scipy.linalg import blas

    return blas


@cache
def _lapack() -> Any:
    from scipy.linalg import lapack

    return lapack
