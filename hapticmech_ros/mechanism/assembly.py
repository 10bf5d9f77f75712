# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""From the authored pose to a consistent one: closures met, velocities tangent to them."""

from __future__ import annotations

import numpy as np

from hapticmech_ros.arrays import Array
from hapticmech_ros.errors import ClosureError
from hapticmech_ros.mechanism.closures import Active
from hapticmech_ros.mechanism.mechanism import Mechanism
from hapticmech_ros.mechanism.model import authored_state

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
