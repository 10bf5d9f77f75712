# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What contacts do at an operational point, in the dynamically consistent sense.

    F_c = J̄ᵀ Σ J_cᵀ λ,      J̄ = D⁻¹ P J_hᵀ X⁺

is the wrench at the point that accelerates it as the contacts do: X F_c = a_c. Along directions
that the joints hold (weight w(s_i) of 1) no wrench does, and F_c has no part there.
"""

from __future__ import annotations

import numpy as np

from hapticmech_ros.arrays import Array
from hapticmech_ros.mechanism.constraint_space import Evaluation
from hapticmech_ros.operational.results import OperationalAnalysis


def contact_wrench(
    terms: Evaluation, analysis: OperationalAnalysis, joint_force: Array, index: int
) -> Array:
    """Return F_c (6,): by the environment on the mechanism, at the point, world axes, N and N m.

    With X n_i = μ_i I_ℓ⁻¹ n_i it is Σ (1 - w_i) n_i (n_iᵀ a_c) / μ_i. T18 of docs/derivations.md.

    Args:
        terms: of the mechanism at a state.
        analysis: of the point there.
        joint_force: (nv,) Σ J_cᵀ λ, N m or N.
        index: of the point.
    """
    space, jacobian = terms.space, terms.points[index].jacobian
    pushed = space.without_closure_part(space.to_mass_metric(joint_force))
    acceleration = jacobian @ space.from_mass_metric(pushed)
    found = analysis.spectrum
    along = found.wrenches.T @ acceleration[analysis.rows]
    free = analysis.weights < 1.0
    shares = np.zeros(along.size)
    shares[free] = (1.0 - analysis.weights[free]) * along[free] / found.mu[free]
    wrench = np.zeros(6)
    wrench[analysis.rows] = found.wrenches @ shares
    return wrench
