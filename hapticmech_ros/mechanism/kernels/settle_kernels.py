# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The end of a step inside a kernel: see :mod:`~hapticmech_ros.mechanism.projection`.

Newton's method finds q on the closures. Its first iterations take the factors of the step's last
stage (a simplified Newton method), and so the closures are factorised once, at the final q.
"""

from __future__ import annotations

import numpy as np

from hapticmech_ros.compilation import inner, put
from hapticmech_ros.mechanism.kernels.closure_kernels import REVOLUTE, WELD
from hapticmech_ros.mechanism.kernels.factor_kernels import NOT_FINITE, factorise, locate
from hapticmech_ros.mechanism.kernels.manifold_kernels import move
from hapticmech_ros.mechanism.kernels.metric_kernels import close_rates, correction_of, lift
from hapticmech_ros.mechanism.kernels.model import Data, Model, Work
from hapticmech_ros.mechanism.tolerances import (
    JUMP,
    LEAST_TOLERANCE,
    NEAR_SINGULAR,
    PROJECTION_ITERATIONS,
    PROJECTION_TOLERANCE,
    SHRINKS,
    SIMPLIFIED,
    SINGULAR,
)
from hapticmech_ros.numerics import Array
from hapticmech_ros.numerics.small_matrices import dot

# How a state ends: on the closures; with a loop that came apart; on the closures, but after a jump,
# or with axes reversed.
SETTLED, OPEN, JUMPED, FLIPPED = 0, 1, 2, 3


@inner
def _size(model: Model, data: Data, change: Array) -> float:
    """Return |Lᵀ change|, the length of a change in the mass metric."""
    lifted = model.turned
    put(lifted, change)
    lift(model, data, lifted)
    return float(np.sqrt(dot(lifted, lifted)))


@inner
def _is_flipped(model: Model, data: Data) -> bool:
    """Return whether axes of a revolute or weld closure are 90° apart or more."""
    for index in range(model.closures.shape[0]):
        kind, a, b = model.closures[index, 0], model.closures[index, 1], model.closures[index, 2]
        if kind == REVOLUTE and dot(data.poses[b, 6:9], data.poses[a, 6:9]) <= 0.0:
            return True
        if kind == WELD and dot(data.poses[b, :9], data.poses[a, :9]) <= 1.0:
            return True
    return False


@inner
def _serves(model: Model, stage: Data) -> bool:
    """Return whether a stage's factors may bring q onto the closures: not near a singularity."""
    rank, sigma = int(stage.tail.rank), stage.sigma
    if sigma.size == 0 or rank == 0:
        return bool(model.m > 0 and stage.tail.least_sigma > SINGULAR)
    return bool(sigma[rank - 1] > SINGULAR * sigma[0])


@inner
def settle(model: Model, stage: Data, data: Data, parts: Work) -> int:
    """Bring q and v onto the closures; with Baumgarte's pull, only see where they are.

    ``stage`` holds the terms of the step's last stage. ``data`` is left with those at the final q.
    After a step, ``parts.theta`` is its change.

    Returns:
        SETTLED, OPEN, JUMPED or FLIPPED; else a negative code, see ``factor``, and
        NOT_FINITE states.
    """
    settings, account, q, theta = parts.settings, parts.account, parts.q, parts.theta
    if not np.isfinite(dot(q, q) + dot(parts.v, parts.v)):
        return NOT_FINITE
    pulled, worst, before = settings.baumgarte_rate > 0.0, np.inf, np.inf
    simplified = SIMPLIFIED if not pulled and _serves(model, stage) else 0
    for iteration in range(PROJECTION_ITERATIONS):
        locate(model, q, data)
        worst, before = data.tail.largest_residual, account.last_residual
        if iteration < simplified and not (
            worst > settings.projection_tolerance and worst < SHRINKS * before
        ):
            simplified = iteration
        rounding = (
            iteration > simplified and worst <= settings.rounding_tolerance and worst > 0.5 * before
        )
        terms = stage
        if iteration >= simplified:
            rank = factorise(model, data)
            if rank < 0:
                return rank
            if model.m == 0:
                return SETTLED
            if pulled:
                break
            # Near a singular position less is left of the tolerance; see ``tolerance_of``.
            least = data.tail.least_sigma
            needed = max(NEAR_SINGULAR * least * least, LEAST_TOLERANCE)
            share = min(1.0, needed / PROJECTION_TOLERANCE)
            if worst <= settings.projection_tolerance * share or rounding:
                worst = 0.0
                break
            terms = data
        if before == np.inf and worst > settings.jump_residual:
            account.step_length = _size(model, terms, theta)
        account.last_residual = worst
        correction_of(model, terms, data.residual, theta)
        if account.step_length < np.inf:
            account.projection_length += _size(model, terms, theta)
        for c in range(theta.size):
            theta[c] = -theta[c]
        move(model, q, theta, q)
    if not worst <= settings.residual_limit:
        return OPEN
    if not pulled:
        close_rates(model, data, parts.v)
        if account.projection_length > JUMP * account.step_length:
            return JUMPED
    return FLIPPED if _is_flipped(model, data) else SETTLED
