# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What factorisations of D and W do, against dense ones of NumPy, whichever way they are made."""

import numpy as np

from hapticmech_ros.mechanism.kernels.factor_kernels import APART
from hapticmech_ros.mechanism.kernels.many_rows import FEW_ROWS, SOME_ROWS
from oracles.closed_form import truncated
from oracles.posed import apart, condition, of_inertia, projector

ROUNDING = 1e-12


def factored_as_dense(state, active):
    """Assert that terms at a state are factored as W's rows, weighed, are by an SVD that is cut."""
    terms = state.evaluate(active)
    space, v = terms.space, state.v
    factor = np.linalg.cholesky(terms.inertia)
    assert apart(space.factor, factor) < ROUNDING
    units = state.mechanism.row_units([index for index, on in enumerate(active) if on])[:, None]
    rows = terms.closure_jacobian / units
    directions, inverse, sigma = truncated(factor, rows, space.rank)
    rounding, magnified = ROUNDING * of_inertia(space), ROUNDING * condition(space)
    # What is cut is small beside what is kept: rows that repeat, and closures that are not met.
    largest = 1e-9 + 10.0 * np.abs(terms.closure_residual).max(initial=0.0)
    assert sigma[space.rank :].max(initial=0.0) < min(largest, 0.03) * sigma.max(initial=1.0)
    near = space.rank and sigma[space.rank - 1] < APART * APART * sigma[0]
    # By reflections, σ are R's diagonal: that is done where none is small.
    if rows.shape[0] < SOME_ROWS or (rows.shape[0] <= FEW_ROWS and near):
        assert apart(space.sigma, sigma[: space.rank]) < rounding
    # Directions turn by rounding over the distance of singular values that are cut from kept ones.
    assert apart(projector(space), directions @ directions.T, 1.0) < magnified
    residual = np.cos(np.arange(rows.shape[0]))
    back = np.linalg.inv(factor).T
    change = back @ (inverse @ (residual / units[:, 0]))
    assert apart(space.correction(residual), change) < magnified
    columns = np.cos(np.arange(4.0 * v.size)).reshape(v.size, 4)
    for one in (columns, columns[:, 0]):
        assert apart(space.to_mass_metric(one), back.T @ one) < rounding
        free = one - directions @ (directions.T @ one)
        assert apart(space.without_closure_part(one), free, 1.0) < magnified
    assert apart(space.from_mass_metric(columns[:, 0]), back @ columns[:, 0]) < rounding
    lifted = factor.T @ v
    kept = back @ (lifted - directions @ (directions.T @ lifted))
    assert apart(space.closed_rates(v), kept, np.abs(v).max()) < magnified
    # And Eq. 1 by them, with the smallest closure forces.
    force = np.cos(np.arange(v.size))
    net = back.T @ (force + terms.effort + terms.passive_force - terms.bias_force)
    surplus = directions @ (directions.T @ net) + inverse @ (terms.closure_bias / units[:, 0])
    found, forces = terms.acceleration(force)
    assert apart(found, back @ (net - surplus)) < magnified
    assert apart(forces, (inverse.T @ surplus) / units[:, 0]) < magnified
