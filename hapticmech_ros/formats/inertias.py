# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Inertias that files say and no body has: mended where that is rounding, or said to be mended."""

from __future__ import annotations

import numpy as np

# Moments this far below zero, as a share of the largest, are rounding of what was written.
ROUNDING = 1e-6
# kg m², below which a moment is rounding in any case.
NO_INERTIA = 1e-12


def balanced(inertia: np.ndarray) -> tuple[np.ndarray, bool]:
    """Return a physically possible inertia (3, 3), kg m², and whether it had to be changed.

    No body has a principal moment above the sum of the other two; files have. The smaller two are
    raised by half of what is missing each. Moments clearly below zero are left for the scene's
    rules to refuse.

    Args:
        inertia: (3, 3) about the centre of mass, kg m², any axes; the result has the same.
    """
    moments, axes = np.linalg.eigh(0.5 * (inertia + inertia.T))
    largest = moments[2]
    if moments[0] < 0.0 and np.abs(moments).max() <= NO_INERTIA:
        return np.zeros((3, 3)), False
    missing = largest - moments[0] - moments[1]
    if moments[0] < -ROUNDING * largest or (moments[0] >= 0.0 and missing <= 1e-9 * largest):
        return inertia, False
    raised = moments + np.array((0.5, 0.5, 0.0)) * max(missing, 0.0)
    made = (axes * np.maximum(raised, 0.0)) @ axes.T
    return made, bool(missing > ROUNDING * largest)
