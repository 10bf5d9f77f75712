# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Projection of a state onto the closures in the mass metric, after every integration step.

q ← q ⊖ D⁻¹Wᵀ(W D⁻¹Wᵀ)⁺ φ,      v ← v - D⁻¹Wᵀ(W D⁻¹Wᵀ)⁺ W v

T2 of docs/derivations.md; the energy that it takes from a loop that latches is T3.

From the authored pose to a consistent one: closures met, velocities tangent to them.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from hapticmech_ros.errors import ClosureError
from hapticmech_ros.mechanism.closures import Active
from hapticmech_ros.mechanism.constraint_space import Closing
from hapticmech_ros.mechanism.mechanism import Mechanism
from hapticmech_ros.mechanism.model import authored_state
from hapticmech_ros.mechanism.tolerances import (
    JUMP,
    LEAST_TOLERANCE,
    NEAR_SINGULAR,
    PROJECTION_FAILURE,
    PROJECTION_ITERATIONS,
    PROJECTION_TOLERANCE,
    ROUNDING_TOLERANCE,
)
from hapticmech_ros.numerics import Array

ASSEMBLY_TOLERANCE = 1e-12
ASSEMBLY_ITERATIONS = 300
# Largest change of any coordinate (rad, or m per characteristic length) in one iteration: short
# steps follow the residual down from the authored pose and stay on the branch nearest to it.
STEP_LIMIT = 0.1


def consistent_initial_state(mechanism: Mechanism) -> tuple[Array, Array]:
    """Return the scene's initial q (nq,) and v (nv,), active closures met to 1e-12 (m, rad).

    Raises:
        ClosureError: the scene cannot close from the pose its author wrote.
    """
    q, v = authored_state(mechanism.scene, mechanism.tree)
    return assemble(mechanism, q, v, mechanism.initially_active)


def assemble(mechanism: Mechanism, q: Array, v: Array, active: Active) -> tuple[Array, Array]:
    """Close the active loops from (q, v): Gauss-Newton in the mass metric with short steps.

    Args:
        mechanism: whose closures.
        q: (nq,) configuration to begin with.
        v: (nv,) rates there, rad/s or m/s.
        active: per closure, whether it is closed.

    Returns:
        q (nq,) and v (nv,) with the loops closed.

    Raises:
        ClosureError: no closed position was reached, or one with axes more than 90° apart.
    """
    names = mechanism.names_of(active)
    for _ in range(ASSEMBLY_ITERATIONS):
        closing = mechanism.closing_terms(q, active)
        residual, space = closing.residual, closing.space
        if not residual.size or np.abs(residual).max() <= ASSEMBLY_TOLERANCE:
            break
        step = -space.correction(residual)
        largest = float(np.abs(step).max())
        if largest > STEP_LIMIT:
            step *= STEP_LIMIT / largest
        q = mechanism.integrate(q, step)
    else:
        worst = float(np.abs(residual).max())
        raise ClosureError("the loops cannot be closed from the authored pose", worst, names)
    for index, on in enumerate(active):
        if on and mechanism.on_wrong_branch(index, q):
            message = "axes of a closure are more than 90 degrees apart; author a nearer pose"
            name = mechanism.closures[index].name
            raise ClosureError(message, float(np.abs(residual).max()), [name])
    return q, space.closed_rates(v)


class Projected(NamedTuple):
    """A state on the closures.

    Attributes:
        q: (nq,) configuration.
        v: (nv,) rates, rad/s or m/s.
        error: largest residual left, m or rad.
        closing: the closures' terms there.
    """

    q: Array
    v: Array
    error: float
    closing: Closing


def project(
    mechanism: Mechanism, q: Array, v: Array, active: Active, change: Array | None = None
) -> Projected:
    """Return (q, v) on the active closures.

    Args:
        mechanism: whose closures.
        q: (nq,) next to the closures.
        v: (nv,) rates there, rad/s or m/s.
        active: which closures are closed.
        change: (nv,) rad or m, of the step that led here; if given, and loops are open by more than
            1e-6 of the length, then putting them right must not take more than half of it, in the
            mass metric.

    Raises:
        ClosureError: the residual stays above 1e-6 of the mechanism's length, or the state jumped.
    """
    rounding = ROUNDING_TOLERANCE * mechanism.length
    before, stepped, corrected = np.inf, np.inf, 0.0
    for _ in range(PROJECTION_ITERATIONS):
        closing = mechanism.closing_terms(q, active)
        residual, space = closing.residual, closing.space
        if not residual.size:
            return Projected(q, v, 0.0, closing)
        worst = closing.error
        if worst <= tolerance_of(closing) * mechanism.length or (
            worst <= rounding and worst > 0.5 * before
        ):
            break
        if change is not None and worst > PROJECTION_FAILURE * mechanism.length:
            stepped = space.size(change)
        before, change = worst, None
        correction = space.correction(residual)
        if np.isfinite(stepped):
            corrected += space.size(correction)
        q = mechanism.integrate(q, -correction)
    else:
        refuse_open(mechanism, worst, active)
    # By more than half: the step ended nowhere near the closures, and the projection may have found
    # another assembly of the mechanism.
    if corrected > JUMP * stepped:
        raise jumped(corrected / stepped, mechanism.names_of(active))
    return Projected(q, space.closed_rates(v), worst, closing)


def tolerance_of(closing: Closing) -> float:
    """Return how far φ may be from 0, as a fraction of the length."""
    return min(PROJECTION_TOLERANCE, max(NEAR_SINGULAR * closing.least**2, LEAST_TOLERANCE))


def refuse_open(mechanism: Mechanism, worst: float, active: Active) -> None:
    """Check the largest residual (m or rad) that is left.

    Raises:
        ClosureError: it is above 1e-6 of the mechanism's length.
    """
    if not worst <= PROJECTION_FAILURE * mechanism.length:
        raise came_apart(worst, mechanism.names_of(active))


def refuse_flipped(mechanism: Mechanism, q: Array, worst: float, active: Active) -> None:
    """Check that axes still have the same direction at q.

    Args:
        mechanism: whose closures.
        q: (nq,) configuration.
        worst: |φ| there, rad or m.
        active: per closure, whether it is closed.

    Raises:
        ClosureError: those of a revolute or weld closure are more than 90° apart, where φ = 0 has
            another root.
    """
    for index, on in enumerate(active):
        if on and mechanism.on_wrong_branch(index, q):
            raise flipped(worst, [mechanism.closures[index].name])


def came_apart(worst: float, names: Sequence[str]) -> ClosureError:
    """Return the error of closures that are left open by ``worst``, m or rad."""
    return ClosureError("a closed loop came apart", worst, names)


def jumped(share: float, names: Sequence[str]) -> ClosureError:
    """Return the error of a projection that took this share of the step before it."""
    rule = "a closed loop jumped: the step is too long for this motion"
    return ClosureError(rule, share, names)


def flipped(worst: float, names: Sequence[str]) -> ClosureError:
    """Return the error of closures whose axes turned round."""
    return ClosureError("a closed loop turned to its other branch", worst, names)
