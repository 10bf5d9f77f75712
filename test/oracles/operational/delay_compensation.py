# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""How an operational point answers through a late loop; see ``delay_compensation_kernels``."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from hapticmech_ros.arrays import Array
from hapticmech_ros.mechanism.closures import Active
from hapticmech_ros.operational.results import RANK_TOLERANCE, CompensatedResponse, Spectrum
from oracles.mechanism.mechanism import ReadableEvaluation, ReadableMechanism

# Off the closures by φ, at a relative singular value σ, free rates turn by φ/σ²: by no more than
# this share of the length, or what is foreseen is not used.
TRUSTED = 0.01


def compensated_response(
    mechanism: ReadableMechanism,
    terms: ReadableEvaluation,
    q: Array,
    v: Array,
    active: Active,
    index: int,
    rows: Array,
    found: Spectrum,
    free_acceleration: Array,
    compensated_delay: float,
    before: Array | None = None,
) -> CompensatedResponse:
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
        compensated_delay: τ, s, 0 or more.
        before: (1 + nv,) how long ago, s, and the rates that were; none, or 0 s, if unknown.
    """
    model, data = mechanism.model, mechanism.data
    pin.computeJointJacobians(model, data, q)
    pin.updateFramePlacements(model, data)
    stiffness, damping = mechanism.elements.tangents(model, data, q, v)
    in_rates, in_place, changed = compensated_delay, compensated_delay**2, np.zeros_like(v)
    if before is not None and before[0] > 0.0:
        # v = w_1 v_1 + w_2 v_2 + h v̇ of the parabola through three rates, by its conditions.
        times = np.array([0.0, -before[0]]) - compensated_delay
        system = np.array([[1.0, 1.0, 0.0], [*times, 1.0], [*times**2, 0.0]])
        one, two, in_rates = np.linalg.solve(system, [1.0, 0.0, 0.0])
        in_place, changed = 0.5 * compensated_delay**2, one * v + two * before[1:] - v
    slope = in_rates * damping + in_place * stiffness
    space, jacobian = terms.space, terms.points[index].jacobian[rows]
    moved = found.s > RANK_TOLERANCE
    free = space.without_closure_part(space.to_mass_metric(jacobian.T))
    along = [space.from_mass_metric(column) for column in np.ascontiguousarray(free.T)]
    rates = (found.wrenches[:, moved] / found.s[moved]).T @ np.array(along)
    later = _predicted(mechanism, terms, q, v, active, compensated_delay)
    own, _ = later.acceleration(np.zeros(v.size))
    acceleration = free_acceleration.copy()
    if later is not terms:
        point = later.points[index]
        acceleration = point.jacobian @ own + point.drift
    met = rates @ (slope @ own + damping @ changed)
    shown = found.duals[:, moved] * found.s[moved]
    resisted = np.eye(len(rates)) + rates @ slope @ rates.T
    inverse_inertia = np.zeros((6, 6))
    inverse_inertia[np.ix_(rows, rows)] = shown @ np.linalg.solve(resisted, shown.T)
    acceleration[rows] -= shown @ np.linalg.solve(resisted, met)
    return CompensatedResponse(inverse_inertia, acceleration)


def _predicted(
    mechanism: ReadableMechanism,
    terms: ReadableEvaluation,
    q: Array,
    v: Array,
    active: Active,
    compensated_delay: float,
) -> ReadableEvaluation:
    """Return the terms at q' and v, or those at q and v where these say more."""
    change = compensated_delay * v
    if terms.closure_bias.size:
        change = change - 0.5 * compensated_delay**2 * terms.space.correction(terms.closure_bias)
    later = mechanism.evaluate(mechanism.integrate(q, change), v, active)
    space, error = later.space, later.closing.error
    allowed = TRUSTED * space.least_kept**2 * mechanism.length
    return later if space.rank == terms.space.rank and error <= allowed else terms
