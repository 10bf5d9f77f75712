# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The rules of integration by name, as numbers for kernels.

Steps are of fixed length, on the configuration manifold; a projection removes drift off the
closures (see :mod:`projection`). Runge–Kutta stages live in local coordinates θ around the step's
start, q = q₀ ⊕ θ, whose rate is θ̇ = J_r(θ)⁻¹ v with J_r the right Jacobian of ⊕ (Munthe-Kaas); on
vector-space joints θ̇ = v.

* ``rk4``: classical Runge–Kutta of order 4;
* ``tsit5``: Tsitouras' rule of order 5 with six stages: for small errors;
* ``rk2``: explicit midpoint rule, order 2: half of rk4's evaluations, enough at haptic rates. On
  the manifold it needs no correction: θ̇ = v holds to the order of the rule;
* ``semi_implicit_euler``: velocity first, then position with the new velocity: order 1;
* ``linearly_implicit``: ROS34PW2, order 3.

Work done and energy lost are integrated with the same weights.

Runge–Kutta rules as numbers for kernels: ROS34PW2, and Tsitouras' rule of order 5.

ROS34PW2 is linearly implicit, for springs, dampers, friction and stops that are stiff. A Rosenbrock
method with weights w, for y = (θ, v) and ẏ = f(y), solves per stage

    k_i = f(y₀ + h Σ_{j<i} α_ij k_j) + h J Σ_{j≤i} γ_ij k_j,      y₁ = y₀ + h Σ w_i k_i.

ROS34PW2 (Rang and Angermann 2005) is stiffly accurate and L-stable, and of order 3 with any J. So J
holds springs and dampers alone: θ̇ = v and v̇ = -A_h (K θ + C v), with A_h the inverse inertia that
the closures leave. Then one small system per stage is left: T5 to T7 of docs/derivations.md.

On the flyball governor at 1 ms, with this J, it is off by 2e-6 m after 10 s; Rosenbrock methods of
order 2 by 9e-6 m (γ = 1 - √½) and 2e-4 m (γ = 1 + √½), generalised-α (spectral radius 0.8, exact
Jacobian, iterated until it converged) by 2.5e-5 m. Motions faster than the step, such as at a hard
stop, lose their energy in it: shorter steps, or substeps, keep it.

Tsitouras' explicit rule of order 5: Ch. Tsitouras, "Runge–Kutta pairs of order 5(4) satisfying only
the first column simplifying assumption", Computers and Mathematics with Applications 62, 2011: the
rule of order 5 of the pair (six stages; its seventh serves the estimate of order 4 alone, which is
not used here: a step is watched by its energy account). The norm of its leading error's
coefficients is 1/56 of rk4's: with half as many evaluations more, steps of smooth motion can be
several times as long.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from hapticmech_ros.mechanism.tolerances import DRIFT

# γ, root of γ³ - 3γ² + 3/2 γ - 1/6.
DIAGONAL = 0.43586652150845900
# α: where stages are reached from those before.
REACHED = np.array(
    (
        (0.0, 0.0, 0.0, 0.0),
        (0.87173304301691801, 0.0, 0.0, 0.0),
        (0.84457060015369423, -0.11299064236484185, 0.0, 0.0),
        (0.0, 0.0, 1.0, 0.0),
    )
)
# γ_ij, j < i: how stages are coupled by J.
COUPLED = np.array(
    (
        (0.0, 0.0, 0.0, 0.0),
        (-0.87173304301691801, 0.0, 0.0, 0.0),
        (-0.90338057013044082, 0.054180672388095326, 0.0, 0.0),
        (0.24212380706095346, -1.2232505839045147, 0.54526025533510214, 0.0),
    )
)
# w = α_4 + γ_4: the last stage is at the end of the step.
WEIGHTS = REACHED[3] + COUPLED[3] + np.array((0.0, 0.0, 0.0, DIAGONAL))

# Tsitouras' rule: where stages are reached from those before; the first one is the step's start.
TSITOURAS_REACHED = np.array(
    (
        (0.0, 0.0, 0.0, 0.0, 0.0, 0.0),
        (0.161, 0.0, 0.0, 0.0, 0.0, 0.0),
        (-0.008480655492356989, 0.335480655492357, 0.0, 0.0, 0.0, 0.0),
        (2.8971530571054935, -6.359448489975075, 4.3622954328695815, 0.0, 0.0, 0.0),
        (
            *(5.325864828439257, -11.748883564062828, 7.4955393428898365),
            *(-0.09249506636175525, 0.0, 0.0),
        ),
        (
            *(5.86145544294642, -12.92096931784711, 8.159367898576159),
            *(-0.071584973281401, -0.028269050394068383, 0.0),
        ),
    )
)
TSITOURAS_WEIGHTS = np.array(
    (
        *(0.09646076681806523, 0.01, 0.4798896504144996),
        *(1.379008574103742, -3.290069515436081, 2.324710524099774),
    )
)


class Scheme(NamedTuple):
    """One of these rules.

    Attributes:
        weights: of the stages in the sums of θ̇, v̇ and powers.
        fractions: of the step, at which the second and later stages are.
        history: whether later stages are reached from all those before, not from the last one.
        late: positions move with the rates at the step's end, not with the sum of θ̇.
        corrected: θ̇ of later stages is J_r(θ)⁻¹ v rather than v.
        implicit: stages are those of a Rosenbrock method, see the module.
        tolerance: of a step's energy account, see :mod:`~hapticmech_ros.mechanism.refinement`,
            if the scene names none; infinite for a rule of order 1, whose own error in a step from
            rest is of the size of the energy exchanged: it is counted, and steps are kept.
        drift: share of the energy exchanged that all steps together may make or lose. It is larger
            for the rule of order 1, whose energy oscillates by the order of the step: removing its
            crests would slow the motion by as much.
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
