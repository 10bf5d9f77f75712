# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Kernels of Eq. 1 at a configuration: factorisation of D and W, accelerations, projections.

Every kernel takes the mechanism's constants as ``numbers`` and ``values`` (see
:mod:`~hapticmech_ros.mechanism.kernels.model`), and what is known of a configuration as one array
``packed`` (see :mod:`~hapticmech_ros.mechanism.kernels.data`).
"""

from __future__ import annotations

import math

from hapticmech_ros.arrays import Array
from hapticmech_ros.compilation import inner, kernel
from hapticmech_ros.mechanism.kernels.articulated_kernels import articulate
from hapticmech_ros.mechanism.kernels.band_kernels import NOT_DECIDED, factor_band
from hapticmech_ros.mechanism.kernels.closure_kernels import COUPLING, residual_of, wrenches_of
from hapticmech_ros.mechanism.kernels.data import Data, unpack
from hapticmech_ros.mechanism.kernels.dense_kernels import factor_dense
from hapticmech_ros.mechanism.kernels.metric_kernels import (
    accelerate,
    close_rates,
    correction_of,
    lift,
)
from hapticmech_ros.mechanism.kernels.model import SPARSE, Model
from hapticmech_ros.mechanism.kernels.pair_kernels import gear_error
from hapticmech_ros.mechanism.kernels.small_matrices import cholesky
from hapticmech_ros.mechanism.kernels.step_layout import (
    ERROR,
    LEAST,
    POTENTIAL,
    RANK,
    RESOLVED_RANK,
)
from hapticmech_ros.mechanism.kernels.tree_kernels import inertia_of, place_tree
from hapticmech_ros.mechanism.tolerances import (
    DRIFT_CAP,
    DRIFT_FACTOR,
    SOLVER_RANK_TOLERANCE,
)

# What a kernel returns that could not do its work, beside ``dense_kernels.NO_SVD`` and
# ``band_kernels.NOT_DECIDED``; below SINGULAR: D is not positive definite at degree of freedom
# SINGULAR - code.
NOT_FINITE, SINGULAR = -2, -3


@inner
def locate(model: Model, q: Array, data: Data) -> None:
    """Fill ``data`` with where everything is at a configuration, and how far loops are open."""
    closures, poses, residual, pairs = model.closures, data.poses, data.residual, data.pairs
    place_tree(model, q, data)
    for index in range(closures.shape[0]):
        row_of = closures[index]
        kind, a, b, first = row_of[0], row_of[1], row_of[2], row_of[3]
        if kind == COUPLING:
            residual[first] = gear_error(model, poses, a, b, q)
            pairs[first, :] = 0.0
            continue
        residual_of(kind, poses, a, b, first, residual)
        wrenches_of(kind, poses, a, b, first, pairs)
    worst = 0.0
    for i in range(model.m):
        worst = max(worst, abs(residual[i]))
    data.tail[ERROR] = worst


@inner
def factorise(model: Model, data: Data) -> int:
    """Fill the rest of ``data`` where :func:`locate` was; see :func:`factor_closures`."""
    residual, lengths, tail = data.residual, model.lengths, data.tail
    drift = 0.0
    for i in range(model.m):
        drift = max(drift, abs(residual[i] / lengths[i]))
    tolerance = max(SOLVER_RANK_TOLERANCE, min(DRIFT_FACTOR * drift, DRIFT_CAP))
    tail[RANK], tail[LEAST], tail[RESOLVED_RANK] = 0.0, 1.0, 0.0
    tail[POTENTIAL] = math.inf
    rank = NOT_DECIDED
    if model.path == SPARSE:
        bad = articulate(model, data)
        if bad < 0:
            rank = factor_band(model, data, tolerance)
    else:
        inertia_of(model, data, data.factor)
        bad = cholesky(data.factor, data.factor)
        if bad < 0:
            rank = factor_dense(model, data, tolerance)
    if bad >= 0:
        return SINGULAR - bad
    tail[RANK] = max(rank, 0)
    return rank


@inner
def factor(model: Model, q: Array, data: Data) -> int:
    """Fill ``data`` at a configuration; see :func:`factor_closures`."""
    locate(model, q, data)
    return factorise(model, data)


@kernel("int64(int64[::1], float64[::1], float64[::1], float64[::1])")
def factor_closures(numbers: Array, values: Array, q: Array, packed: Array) -> int:
    """Fill ``packed`` at a configuration.

    Args:
        numbers: (integers,) constants of the mechanism, whole ones.
        values: (numbers,) the others; see ``model.pack``.
        q: (nq,) configuration.
        packed: (size,) to fill.

    Returns:
        The rank r; or NO_SVD, SINGULAR and below, or NOT_DECIDED of a sparse factorisation.
    """
    model = Model(numbers, values)
    return factor(model, q, unpack(packed, model))


@kernel(
    "void(int64[::1], float64[::1], float64[::1], float64[::1], float64[::1], float64[::1],"
    " float64[::1])"
)
def solve_motion(
    numbers: Array,
    values: Array,
    packed: Array,
    bias_force: Array,
    passive: Array,
    bias: Array,
    result: Array,
) -> None:
    """Solve Eq. 1: see :func:`accelerate`.

    Args:
        numbers: (integers,) constants of the mechanism, whole ones.
        values: (numbers,) the others; see ``model.pack``.
        packed: (size,) packed terms at the configuration.
        bias_force: (nv,) h, N m or N.
        passive: (nv,) forces of elements without efforts, N m or N.
        bias: (m,) Ẇv, m/s² or 1/s².
        result: (nv + m,) Σ Jᵀ F and efforts, N m or N, replaced by v̇ and λ; λ is NaN if sparse.
    """
    model = Model(numbers, values)
    accelerate(model, unpack(packed, model), bias_force, passive, bias, result)


@kernel("void(int64[::1], float64[::1], float64[::1], float64[::1], float64[::1])")
def correct(numbers: Array, values: Array, packed: Array, residual: Array, change: Array) -> None:
    """Fill ``change``: see :func:`correction_of`.

    Args:
        numbers: (integers,) constants of the mechanism, whole ones.
        values: (numbers,) the others; see ``model.pack``.
        packed: (size,) packed terms at the configuration.
        residual: (m,) φ, rad or m.
        change: (nv,) to fill, rad or m.
    """
    model = Model(numbers, values)
    correction_of(model, unpack(packed, model), residual, change)


@kernel("void(int64[::1], float64[::1], float64[::1], float64[::1])")
def keep_closed(numbers: Array, values: Array, packed: Array, rates: Array) -> None:
    """Replace rates: see :func:`close_rates`.

    Args:
        numbers: (integers,) constants of the mechanism, whole ones.
        values: (numbers,) the others; see ``model.pack``.
        packed: (size,) packed terms at the configuration.
        rates: (nv,) rad/s or m/s, replaced by the nearest with W v = 0.
    """
    model = Model(numbers, values)
    close_rates(model, unpack(packed, model), rates)


@kernel("void(int64[::1], float64[::1], float64[::1], float64[::1])")
def lift_rates(numbers: Array, values: Array, packed: Array, rates: Array) -> None:
    """Replace rates: see ``metric_kernels.lift``.

    Args:
        numbers: (integers,) constants of the mechanism, whole ones.
        values: (numbers,) the others; see ``model.pack``.
        packed: (size,) packed terms at the configuration.
        rates: (nv,) rates or a change of q, replaced by Lᵀ of them, in the mass metric.
    """
    model = Model(numbers, values)
    lift(model, unpack(packed, model), rates)
