# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The rules of integration by name, as numbers for kernels.

Steps are of fixed length, on the configuration manifold; what drifts off the closures is put back
(see :mod:`projection`). Runge–Kutta stages live in local coordinates θ around the step's start,
q = q₀ ⊕ θ, whose rate is θ̇ = J_r(θ)⁻¹ v with J_r the right Jacobian of ⊕ (Munthe-Kaas); on
vector-space joints θ̇ = v.

* ``rk4``: classical Runge–Kutta of order 4;
* ``tsit5``: Tsitouras' rule of order 5 with six stages, see :mod:`tableaus`: for small errors;
* ``rk2``: explicit midpoint rule, order 2: half of rk4's evaluations, enough at haptic rates. On
  the manifold it needs no correction: θ̇ = v holds to the order of the rule;
* ``semi_implicit_euler``: velocity first, then position with the new velocity: order 1;
* ``linearly_implicit``: ROS34PW2, order 3, see :mod:`tableaus`.

Work done and energy lost are integrated with the same weights.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from hapticmech_ros.mechanism.tableaus import (
    REACHED,
    TSITOURAS_REACHED,
    TSITOURAS_WEIGHTS,
    WEIGHTS,
)
from hapticmech_ros.mechanism.tolerances import DRIFT


class Scheme(NamedTuple):
    """One of these rules.

    Attributes:
        weights: of the stages in the sums of θ̇, v̇ and powers.
        fractions: of the step, at which the second and later stages are.
        history: whether later stages are reached from all those before, not from the last one.
        late: positions move with the rates at the step's end, not with the sum of θ̇.
        corrected: θ̇ of later stages is J_r(θ)⁻¹ v rather than v.
        implicit: stages are those of :mod:`~hapticmech_ros.mechanism.tableaus`.
        tolerance: of a step's energy account, see :mod:`~hapticmech_ros.mechanism.energy_balance`,
            if the scene names none; infinite for a rule of order 1, whose own error in a step from
            rest is of the size of what is exchanged: it is counted, and steps are left as they are.
        drift: share of what was exchanged that all steps together may make or lose. More for
            the rule of order 1, whose energy swings by the order of the step, and comes back: to
            take its crests out of the motion would leave it slower by as much.
    """

    weights: tuple[float, ...]
    fractions: tuple[float, ...]
    history: bool = False
    late: bool = False
    corrected: bool = False
    implicit: bool = False
    tolerance: float = 1e-6
    drift: float = DRIFT


SCHEMES: dict[str, Scheme] = {
    "rk4": Scheme((1 / 6, 1 / 3, 1 / 3, 1 / 6), (0.5, 0.5, 1.0), corrected=True),
    "tsit5": Scheme(
        tuple(TSITOURAS_WEIGHTS.tolist()),
        tuple(TSITOURAS_REACHED.sum(axis=1).tolist()[1:]),
        history=True,
        corrected=True,
    ),
    "rk2": Scheme((0.0, 1.0), (0.5,), tolerance=1e-4),
    "semi_implicit_euler": Scheme((1.0,), (), late=True, tolerance=math.inf, drift=1e-2),
    "linearly_implicit": Scheme(
        tuple(WEIGHTS.tolist()),
        tuple(REACHED.sum(axis=1).tolist()[1:]),
        corrected=True,
        implicit=True,
        tolerance=1e-5,
    ),
}
