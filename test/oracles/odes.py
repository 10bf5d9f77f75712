# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Initial value problems solved as tightly as double precision allows."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from scipy.integrate import solve_ivp

Array = np.ndarray
Rates = Callable[[float, Array], Array]


def solve(rates: Rates, start: Sequence[float], times: Sequence[float]) -> Array:
    """Return the states (times, n) at ``times``, after 0 and increasing; explicit, order 8."""
    return _through(rates, start, times, "DOP853", 1e-13)


def solve_stiff(rates: Rates, start: Sequence[float], times: Sequence[float]) -> Array:
    """Return the states (times, n) at ``times``, after 0 and increasing; implicit, order 5."""
    return _through(rates, start, times, "Radau", 1e-10)


def _through(
    rates: Rates, start: Sequence[float], times: Sequence[float], method: str, tolerance: float
) -> Array:
    # A stop at each time: in between there is only an interpolation of lower order.
    states = [np.asarray(start, dtype=float)]
    for before, after in zip((0.0, *times), times, strict=False):
        solved = solve_ivp(
            rates, (before, after), states[-1], method, rtol=tolerance, atol=tolerance
        )
        if not solved.success:
            raise ArithmeticError(solved.message)
        states.append(solved.y[:, -1])
    return np.array(states[1:])
