# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Five-point central differences: truncation h^4 f5/30, h^4 f6/90; rounding eps/h, eps/h^2."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

Array = np.ndarray


def derivative(f: Callable[[float], Array], h: float = 1e-3) -> Array:
    """Return f'(0)."""
    return np.asarray((f(-2 * h) - 8.0 * f(-h) + 8.0 * f(h) - f(2 * h)) / (12.0 * h))


def second_derivative(f: Callable[[float], Array], h: float = 4e-3) -> Array:
    """Return f''(0)."""
    outer = f(-2 * h) + f(2 * h)
    inner = f(-h) + f(h)
    return np.asarray((-outer + 16.0 * inner - 30.0 * f(0.0)) / (12.0 * h * h))


def columns(f: Callable[[Array], Array], size: int, h: float = 1e-3) -> Array:
    """Return the Jacobian at 0 of f, a function of a vector of ``size`` numbers."""
    units = np.eye(size)
    parts = [derivative(lambda t, unit=unit: f(t * unit), h) for unit in units]
    return np.stack(parts, axis=1)


def relative(found: Array, expected: Array, scale: float | None = None) -> float:
    """Return |found - expected| over |expected| (or ``scale``): never an absolute tolerance."""
    size = float(np.linalg.norm(expected)) if scale is None else scale
    return float(np.linalg.norm(np.asarray(found) - np.asarray(expected))) / size
