"""The end of a step by a kernel: what :mod:`projection` says in plain NumPy, a round a call."""

from __future__ import annotations

import numpy as np

from hapticmech_ros.compilation import inner, kernel
from hapticmech_ros.mechanism.compiled.closure_kernels import REVOLUTE, WELD
from hapticmech_ros.mechanism.compiled.kernels import NOT_FINITE, close_rates, correction_of, factor
from hapticmech_ros.mechanism.compiled.packed import Packed, unpack
from hapticmech_ros.mechanism.compiled.small_matrices import dot
from hapticmech_ros.mechanism.compiled.step_kernels import step_parts
from hapticmech_ros.mechanism.compiled.tables import Tables, unfold
from hapticmech_ros.mechanism.model import Array
from hapticmech_ros.mechanism.projection import (
    JUMP,
    LEAST_TOLERANCE,
    NEAR_SINGULAR,
    PROJECTION_TOLERANCE,
)

# What a round says: on the closures; to be moved by ``work.theta`` and seen again; on the closures,
# but after a jump, or with axes the other way.
SETTLED, OFF, JUMPED, FLIPPED = 0, 1, 2, 3


@inner
def _size(space: Packed, change: Array) -> float:
    """Return |Lᵀ change|, the length of a change in the mass metric."""
    total = 0.0
    for i in range(change.size):
        along = 0.0
        for k in range(i, change.size):
            along += space.factor[k, i] * change[k]
        total += along * along
    return float(np.sqrt(total))


@inner
def _share_of_tolerance(least: float) -> float:
    """Return what is left of the tolerance near a singular position; see ``tolerance_of``."""
    needed = max(NEAR_SINGULAR * least * least, LEAST_TOLERANCE)
    return float(min(1.0, needed / PROJECTION_TOLERANCE))


@inner
def _is_flipped(tables: Tables, space: Packed) -> bool:
    """Return whether axes of a revolute or weld closure are more than 90° apart."""
    for index in range(tables.closures.shape[0]):
        kind, a, b = tables.closures[index, 0], tables.closures[index, 1], tables.closures[index, 2]
        if kind == REVOLUTE and dot(space.poses[b, 6:9], space.poses[a, 6:9]) <= 0.0:
            return True
        if kind == WELD and dot(space.poses[b, :9], space.poses[a, :9]) <= 1.0:
            return True
    return False


@kernel(
    "int64(int64[::1], float64[::1], float64[:,::1], float64[:,::1], float64[:,::1],"
    " float64[::1], float64[::1])"
)
def settle(
    numbers: Array,
    values: Array,
    inertia: Array,
    joint_jacobian: Array,
    joint_poses: Array,
    packed: Array,
    work: Array,
) -> int:
    """Do one round of the projection at ``work.q``; with Baumgarte's pull, find terms there.

    Returns:
        SETTLED: ``work.v`` is tangent to the closures. OFF: ``work.theta`` leads towards them, and
        ``work.q`` is moved where it is a vector. JUMPED, FLIPPED: see ``projection.project`` and
        ``refuse_flipped``. Else a negative code; see ``factor_closures``, and NOT_FINITE states.
    """
    tables = unfold(numbers, values)
    parts = step_parts(work, tables.nq, tables.nv)
    if not np.isfinite(dot(parts.q, parts.q) + dot(parts.v, parts.v)):
        return NOT_FINITE
    space = unpack(packed, tables.nv, tables.m)
    rank = factor(tables, inertia, joint_jacobian, joint_poses, space)
    if rank < 0 or tables.m == 0:
        return rank
    settings, account = parts.settings, parts.account
    if settings[5] > 0.0:
        return FLIPPED if _is_flipped(tables, space) else SETTLED
    worst, before = space.tail[0], account[2]
    rounding = worst <= settings[3] and worst > 0.5 * before
    if worst <= settings[2] * _share_of_tolerance(space.tail[2]) or rounding:
        close_rates(space, rank, parts.v)
        if account[4] > JUMP * account[3]:
            return JUMPED
        return FLIPPED if _is_flipped(tables, space) else SETTLED
    if before == np.inf and worst > settings[4]:
        account[3] = _size(space, parts.theta)
    account[2] = worst
    correction_of(space, rank, space.residual, parts.theta)
    if account[3] < np.inf:
        account[4] += _size(space, parts.theta)
    for c in range(tables.nv):
        parts.theta[c] = -parts.theta[c]
        if tables.nq == tables.nv:
            parts.q[c] += parts.theta[c]
    return OFF
