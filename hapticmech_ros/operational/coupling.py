# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""How what one hand does to a mechanism moves another one's operational point.

F_j, by the hand at point j, accelerates point i by X_ij F_j: part of the F_c of point i, of which
its device gives as much as it gives of a contact. The last F_j that the mechanism knows answers a
sample taken a period ago; what has changed since is added in the device, see
:mod:`~hapticmech_ros.control.other_hands`.
"""

from __future__ import annotations

import numpy as np

from hapticmech_ros.arrays import Array
from hapticmech_ros.mechanism.evaluation import Evaluation
from hapticmech_ros.operational.results import OperationalAnalysis


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


def transmission(found: OperationalAnalysis, coupled: Array) -> Array:
    """Return Y_ij (6, 6): a wrench F_j at point j is felt at point i as F_c = Y_ij F_j.

    Y_ij = Σ_k (1 - w_k) n_k n_kᵀ X_ij / s_k², the sum over the directions of point i (T18), so that
    X_ii Y_ij = X_ij along all that the joints do not constrain there.

    Args:
        found: analysis of point i.
        coupled: (6, 6) X_ij, see :func:`coupling`; 1/kg, 1/(kg m) and 1/(kg m²), world axes.

    Returns:
        1, m and 1/m; force before torque, world axes at each point.
    """
    rows, felt = found.rows, found.weights < 1.0
    wrenches = found.spectrum.wrenches[:, felt]
    shares = (1.0 - found.weights[felt]) / found.spectrum.s[felt] ** 2
    whole = np.zeros((6, 6))
    whole[rows] = wrenches @ (shares[:, None] * (wrenches.T @ coupled[rows]))
    return whole
