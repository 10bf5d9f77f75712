"""How an operational point answers, seen through a loop that is late by τ.

What springs and dampers do, K and C at a state, reaches the hand τ late; a force takes effect while
it is on the way. A mechanism whose inertia is D + τ C + τ² K, and whose springs are where they will
be after τ, answers now as the true one will have answered by then, to first order in τ:

    X_τ = J (D + τ C + τ² K)⁻¹ Jᵀ,      a_τ = a_0 - J (D + τ C + τ² K)⁻¹ ((τ C + τ² K) v̇_0 + τ K v)

where v̇_0 are the accelerations at zero hand wrench and closures hold on as they do in X. Both are
found in the directions of X alone: with rows ζ_i = n_iᵀ J D⁻¹ / s_i, closures kept, orthonormal in
the mass metric, and B = 1 + ζ (τ C + τ² K) ζᵀ, which is never smaller than 1,

    X_τ = Z Bᵀ⁻¹ Zᵀ,  a_τ = a_0 - Z B⁻¹ ζ ((τ C + τ² K) v̇_0 + τ K v),   Z = I_ℓ⁻¹ n_i s_i

as columns. How joints that move without the point resist them is left out of B, which is exact to
first order too; and B being no smaller than 1, no gain is larger than X's.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pinocchio as pin

from hapticmech_ros.mechanism.evaluation import Evaluation
from hapticmech_ros.mechanism.mechanism import Mechanism
from hapticmech_ros.mechanism.model import Array
from hapticmech_ros.operational.spectrum import RANK_TOLERANCE, Spectrum


class LateAnswer(NamedTuple):
    """What stands for X and a_0 in a late loop, world axes at the operational point.

    Attributes:
        inverse_inertia: (6, 6) X_τ; 1/kg, 1/(kg m), 1/(kg m²).
        free_acceleration: (6,) a_τ, m/s² and rad/s².
    """

    inverse_inertia: Array
    free_acceleration: Array


def late_answer(
    mechanism: Mechanism,
    terms: Evaluation,
    q: Array,
    v: Array,
    index: int,
    rows: Array,
    found: Spectrum,
    free_acceleration: Array,
    lateness: float,
) -> LateAnswer:
    """Return X_τ and a_τ of a point.

    Args:
        mechanism: whose springs, dampers, friction and stops.
        terms: of Eq. 1 at the state.
        q: (nq,) configuration.
        v: (nv,) rates.
        index: of the point.
        rows: (t,) rows of a six-vector that the task space has.
        found: spectrum of X there.
        free_acceleration: (6,) a_0.
        lateness: τ, s, 0 or more.
    """
    model, data = mechanism.model, mechanism.data
    pin.computeJointJacobians(model, data, q)
    pin.updateFramePlacements(model, data)
    stiffness, damping = mechanism.elements.tangents(model, data, q, v)
    slope = lateness * damping + lateness**2 * stiffness
    space, jacobian = terms.space, terms.points[index].jacobian[rows]
    moved = found.s > RANK_TOLERANCE
    free = space.without_closure_part(space.to_mass_metric(jacobian.T))
    along = [space.from_mass_metric(column) for column in np.ascontiguousarray(free.T)]
    rates = (found.wrenches[:, moved] / found.s[moved]).T @ np.array(along)
    own, _ = terms.acceleration(np.zeros(v.size))
    met = rates @ (slope @ own + lateness * (stiffness @ v))
    shown = found.duals[:, moved] * found.s[moved]
    resisted = np.eye(len(rates)) + rates @ slope @ rates.T
    inverse_inertia, acceleration = np.zeros((6, 6)), free_acceleration.copy()
    inverse_inertia[np.ix_(rows, rows)] = shown @ np.linalg.solve(resisted, shown.T)
    acceleration[rows] -= shown @ np.linalg.solve(resisted, met)
    return LateAnswer(inverse_inertia, acceleration)
