# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Tsitouras' explicit Runge–Kutta rule of order 5, as numbers for kernels.

Ch. Tsitouras, "Runge–Kutta pairs of order 5(4) satisfying only the first column simplifying
assumption", Computers and Mathematics with Applications 62, 2011: the rule of order 5 of the pair
(six stages; its seventh serves the estimate of order 4 alone, which is not used here: a step is
watched by its energy account). The norm of its leading error's coefficients is 1/56 of rk4's, so
that steps of smooth motion can be several times as long for half as many evaluations more.
"""

from __future__ import annotations

import numpy as np

# α: where stages are reached from those before; the first one is the step's start.
REACHED = np.array(
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
WEIGHTS = np.array(
    (
        *(0.09646076681806523, 0.01, 0.4798896504144996),
        *(1.379008574103742, -3.290069515436081, 2.324710524099774),
    )
)
