"""How an operational point answers, seen through a loop that is late by τ.

What springs, dampers and weight do at a state reaches the hand τ late; a force takes effect while
it is on the way. So the state is foreseen: q' is where the mechanism will be after τ at its rates,
and with K and C of what springs and dampers do to a change, its inertia is D + τ C + τ² K. Then

    X_τ = J (D + τ C + τ² K)⁻¹ Jᵀ
    a_τ = a_0(q', v) - J (D + τ C + τ² K)⁻¹ (τ C + τ² K) v̇_0(q', v)

where v̇_0 are the accelerations at zero hand wrench, and closures hold on as they do in X. That is
a step of length τ, implicit in springs and dampers: X_τ F + a_τ is the acceleration by then, but
for what Coriolis forces change as v does, and for what X does on the way. Both are found in the
directions of X alone: with rows ζ_i = n_iᵀ J D⁻¹ / s_i, closures kept, which are orthonormal
in the mass metric, and B = 1 + ζ (τ C + τ² K) ζᵀ, which is never smaller than 1,

    X_τ = Z B⁻¹ Zᵀ,  a_τ = a_0(q', v) - Z B⁻¹ ζ (τ C + τ² K) v̇_0(q', v)

with columns I_ℓ⁻¹ n_i s_i in Z. How joints that move without the point resist them is left out of
B, which is exact to first order too; and B being no smaller than 1, no gain is larger than X's.

To second order q' = q ⊕ (τ v - ½ τ² D⁻¹Wᵀ(W D⁻¹Wᵀ)⁺ Ẇv) is on the closures. Next to a singular
position, where what is left of φ there turns free rates by more than 1 %, q' is q.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import pinocchio as pin

from hapticmech_ros.arrays import Array
from hapticmech_ros.mechanism.closures import Active
from hapticmech_ros.operational.spectrum import RANK_TOLERANCE, Spectrum

# The readable ones, of test/oracles/mechanism.
Mechanism = Any
Evaluation = Any

# Off the closures by φ, at a relative singular value σ, free rates turn by φ/σ²: by no more than
# this share of the length, or what is foreseen is not used.
TRUSTED = 0.01


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
    active: Active,
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
        active: which closures are closed.
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
    later = _foreseen(mechanism, terms, q, v, active, lateness)
    own, _ = later.acceleration(np.zeros(v.size))
    acceleration = free_acceleration.copy()
    if later is not terms:
        point = later.points[index]
        acceleration = point.jacobian @ own + point.drift
    met = rates @ (slope @ own)
    shown = found.duals[:, moved] * found.s[moved]
    resisted = np.eye(len(rates)) + rates @ slope @ rates.T
    inverse_inertia = np.zeros((6, 6))
    inverse_inertia[np.ix_(rows, rows)] = shown @ np.linalg.solve(resisted, shown.T)
    acceleration[rows] -= shown @ np.linalg.solve(resisted, met)
    return LateAnswer(inverse_inertia, acceleration)


def _foreseen(
    mechanism: Mechanism,
    terms: Evaluation,
    q: Array,
    v: Array,
    active: Active,
    lateness: float,
) -> Evaluation:
    """Return the terms at q' and v, or those at q and v where these say more."""
    change = lateness * v
    if terms.closure_bias.size:
        change = change - 0.5 * lateness**2 * terms.space.correction(terms.closure_bias)
    later = mechanism.evaluate(mechanism.integrate(q, change), v, active)
    space, error = later.space, later.closing.error
    allowed = TRUSTED * space.least_kept**2 * mechanism.length
    return later if space.rank == terms.space.rank and error <= allowed else terms
