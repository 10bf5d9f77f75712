# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Runge–Kutta rules as numbers for kernels: ROS34PW2, and Tsitouras' rule of order 5.

ROS34PW2 is linearly implicit, for springs, dampers, friction and stops that are stiff. A Rosenbrock
method with weights w, for y = (θ, v) and ẏ = f(y), solves per stage

    k_i = f(y₀ + h Σ_{j<i} α_ij k_j) + h J Σ_{j≤i} γ_ij k_j,      y₁ = y₀ + h Σ w_i k_i.

ROS34PW2 (Rang and Angermann 2005) is stiffly accurate and L-stable, and of order 3 with any J. So J
holds springs and dampers alone: θ̇ = v and v̇ = -A_h (K θ + C v), with A_h the inverse inertia that
the closures leave. Then one small system per stage is left: T5 to T7 of docs/derivations.md.

On the flyball governor at 1 ms, with this J, it is off by 2e-6 m after 10 s; Rosenbrock methods of
order 2 by 9e-6 m (γ = 1 - √½) and 2e-4 m (γ = 1 + √½), generalised-α (spectral radius 0.8, exact
Jacobian, iterated until it converged) by 2.5e-5 m. What turns faster than the step, such as a hard
stop, loses its energy in it: shorter steps, or substeps, give it back.

Tsitouras' explicit rule of order 5: Ch. Tsitouras, "Runge–Kutta pairs of order 5(4) satisfying only
the first column simplifying assumption", Computers and Mathematics with Applications 62, 2011: the
rule of order 5 of the pair (six stages; its seventh serves the estimate of order 4 alone, which is
not used here: a step is watched by its energy account). The norm of its leading error's
coefficients is 1/56 of rk4's, so that steps of smooth motion can be several times as long for half
as many evaluations more.
"""

from __future__ import annotations

import numpy as np

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
