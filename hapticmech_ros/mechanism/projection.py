"""Projection of a state onto the closures in the mass metric, after every integration step.

q ← q ⊖ D⁻¹Wᵀ(W D⁻¹Wᵀ)⁺ φ,      v ← v - D⁻¹Wᵀ(W D⁻¹Wᵀ)⁺ W v
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from hapticmech_ros.errors import ClosureError
from hapticmech_ros.mechanism.mechanism import Active, Closing, Mechanism
from hapticmech_ros.mechanism.model import Array

# The loop stops once φ is this fraction of the mechanism's length (rad for axes): next to rounding,
# since close to a singular position, at a relative singular value σ, an error of φ turns the free
# velocities by φ/σ². On the N-four-bar 1e-11 cost five digits.
PROJECTION_TOLERANCE = 1e-14
# It also stops where φ is this small and halves no more: rounding, far from the world's origin...
ROUNDING_TOLERANCE = 1e-11
# ...and a loop that is still open by this fraction after all iterations has come apart.
PROJECTION_FAILURE = 1e-6
PROJECTION_ITERATIONS = 10


class Projected(NamedTuple):
    """A state on the closures, the largest residual left (m or rad), and the terms found there."""

    q: Array
    v: Array
    error: float
    closing: Closing


def project(mechanism: Mechanism, q: Array, v: Array, active: Active) -> Projected:
    """Return (q, v) on the active closures.

    Raises:
        ClosureError: the residual stays above 1e-6 of the mechanism's length.
    """
    tolerance = PROJECTION_TOLERANCE * mechanism.length
    rounding = ROUNDING_TOLERANCE * mechanism.length
    before = np.inf
    for _ in range(PROJECTION_ITERATIONS):
        closing = mechanism.closing_terms(q, active)
        residual, space = closing.residual, closing.space
        if not residual.size:
            return Projected(q, v, 0.0, closing)
        worst = closing.error
        if worst <= tolerance or (worst <= rounding and worst > 0.5 * before):
            break
        before = worst
        q = mechanism.integrate(q, -space.correction(residual))
    else:
        refuse_open(mechanism, worst, active)
    return Projected(q, space.closed_rates(v), worst, closing)


def refuse_open(mechanism: Mechanism, worst: float, active: Active) -> None:
    """Check the largest residual (m or rad) that is left after all iterations.

    Raises:
        ClosureError: it is above 1e-6 of the mechanism's length.
    """
    if not worst <= PROJECTION_FAILURE * mechanism.length:
        names = mechanism.names_of(active)
        raise ClosureError("a closed loop came apart", worst, names)
