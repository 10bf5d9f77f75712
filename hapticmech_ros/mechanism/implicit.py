"""The linearly implicit rule ROS34PW2, for springs, dampers, friction and stops that are stiff.

A Rosenbrock method with weights w, for y = (θ, v) and ẏ = f(y), solves per stage

    k_i = f(y₀ + h Σ_{j<i} α_ij k_j) + h J Σ_{j≤i} γ_ij k_j,      y₁ = y₀ + h Σ w_i k_i.

This one (Rang and Angermann 2005) is stiffly accurate and L-stable, and of order 3 with any J. So J
holds springs and dampers alone: θ̇ = v and v̇ = -A_h (K θ + C v), with A_h the inverse inertia that
the closures leave. Then one small system per stage is left: T5 to T7 of docs/derivations.md.

On the flyball governor at 1 ms, with this J, it is off by 2e-6 m after 10 s; Rosenbrock methods of
order 2 by 9e-6 m (γ = 1 - √½) and 2e-4 m (γ = 1 + √½), generalised-α (spectral radius 0.8, exact
Jacobian, iterated until it converged) by 2.5e-5 m. What turns faster than the step, such as a hard
stop, loses its energy in it: shorter steps, or substeps, give it back.
"""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from hapticmech_ros.mechanism.constraint_space import ConstraintSpace, singular_inertia
from hapticmech_ros.mechanism.integrator import Advance, Motion, local_rate
from hapticmech_ros.mechanism.lapack import dpotrf, dtrsv
from hapticmech_ros.mechanism.model import Array

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


class Springs:
    """Springs and dampers linearised at a step's start; see ``integrator.Resistance``.

    With P = 1 - U Uᵀ and Ŝ = L⁻¹ S L⁻ᵀ, x = L⁻ᵀ (1 + P Ŝ P)⁻¹ P L⁻¹ force: the factorisation of D
    and W serves, and what is factored anew is never worse than 1 + |Ŝ|.

    Args:
        space: factorisation of D and W.
        stiffness, damping: (nv, nv) K and C, symmetric, positive semi-definite.
        reach: γh, s.

    Raises:
        SingularInertiaError: K or C is not finite.
    """

    def __init__(
        self, space: ConstraintSpace, stiffness: Array, damping: Array, reach: float
    ) -> None:
        self.stiffness, self.damping = stiffness, damping
        self.slope = reach * damping + reach**2 * stiffness
        self._space = space
        half = space.without_closure_part(space.to_mass_metric(self.slope))
        free = space.without_closure_part(space.to_mass_metric(half.T))
        self._factor, info = dpotrf(np.eye(len(free)) + free, lower=1)
        if info != 0:
            raise singular_inertia(info - 1)

    def answer(self, force: Array) -> Array:
        """Return x (nv,) with (D + S) x + Wᵀμ = force and W x = 0."""
        space = self._space
        free = space.without_closure_part(space.to_mass_metric(force))
        free = dtrsv(self._factor, free, lower=1)
        return space.from_mass_metric(dtrsv(self._factor, free, lower=1, trans=1))


def linearly_implicit(
    model: pin.Model, motion: Motion, q: Array, v: Array, period: float
) -> Advance:
    """ROS34PW2, order 3. Powers are further components of y, in which J is zero."""
    flat = model.nq == model.nv
    springs = motion.resistance(q, v, period, DIAGONAL * period)
    turns, gains = np.zeros((4, v.size)), np.zeros((4, v.size))
    work, lost = 0.0, 0.0
    for stage, weight in enumerate(WEIGHTS.tolist()):
        reached, coupled = REACHED[stage], COUPLED[stage]
        speed = v + period * (reached @ gains)
        if stage == 0:
            rates, turn = motion(q, v), v
        else:
            theta = period * (reached @ turns)
            rates = motion(pin.integrate(model, q, theta), speed)
            turn = speed if flat else local_rate(model, q, theta, speed)
        turn = turn + period * (coupled @ gains)
        gain = rates.acceleration
        if springs is not None:
            met = springs.stiffness @ (DIAGONAL * turn + coupled @ turns)
            met += springs.damping @ (coupled @ gains)
            gain = gain - springs.answer(springs.slope @ gain + period * met)
        turns[stage], gains[stage] = turn + period * DIAGONAL * gain, gain
        work += weight * rates.power_in
        lost += weight * rates.power_lost
    change = period * (WEIGHTS @ turns)
    return Advance(
        np.asarray(pin.integrate(model, q, change)),
        v + period * (WEIGHTS @ gains),
        change,
        period * work,
        period * lost,
    )
