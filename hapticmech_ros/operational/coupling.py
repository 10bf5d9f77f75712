# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""How what one hand does to a mechanism moves another one's operational point.

F_j, by the hand at point j, accelerates point i by X_ij F_j: part of the F_c of point i, of which
its device gives as much as it gives of a contact. It gives it late: the last F_j that is known
answers a sample taken a period ago, and what is answered with it acts in the next period. Nothing
is extrapolated: a lead passes on more at some tens of Hz than it takes, and two arms on a light
body between them then oscillate.
"""

from __future__ import annotations

import numpy as np

from hapticmech_ros.arrays import Array
from hapticmech_ros.mechanism.evaluation import Evaluation


def coupling(terms: Evaluation) -> Array:
    """Return X (points, points, 6, 6), the inverse inertia of all operational points together.

    X_ij = J_i L⁻ᵀ (1 - U Uᵀ) L⁻¹ J_jᵀ: a wrench F_j at point j accelerates point i by X_ij F_j,
    with loops closed. X_ii is Λ_h⁻¹ of point i, and X_ji = X_ijᵀ.

    Args:
        terms: of the mechanism at a state.

    Returns:
        1/kg, 1/(kg m) and 1/(kg m²); force before torque, world axes at each point.
    """
    space, n = terms.space, len(terms.points)
    columns = np.hstack([point.jacobian.T for point in terms.points])
    free = space.without_closure_part(space.to_mass_metric(columns))
    whole = free.T @ free
    return np.ascontiguousarray(whole.reshape(n, 6, n, 6).transpose(0, 2, 1, 3))


def by_others(terms: Evaluation, wrenches: Array) -> Array:
    """Return joint forces (points, nv), N m or N: for each point, what acts at all the others.

    Row i is the sum of J_jᵀ F_j over all j ≠ i. The point's acceleration by it is the sum of
    X_ij F_j, with X_ij of :func:`coupling`.

    Args:
        terms: of the mechanism at a state.
        wrenches: (points, 6) F_j, on the mechanism, N and N m, world axes at each point.
    """
    forces = np.array([p.jacobian.T @ f for p, f in zip(terms.points, wrenches, strict=True)])
    return np.asarray(forces.sum(axis=0) - forces)
