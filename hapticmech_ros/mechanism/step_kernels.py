"""A step of the mechanism by kernels: a stage of the integrator, and a round of the projection.

What :mod:`~hapticmech_ros.mechanism.integrator` and :mod:`~hapticmech_ros.mechanism.projection` say
in plain NumPy, on one array of work. Between two calls Pinocchio computes D, h, joint Jacobians and
poses at ``work.q`` and ``work.v``.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from hapticmech_ros.compilation import inner, kernel
from hapticmech_ros.mechanism.kernels import (
    NOT_FINITE,
    accelerate,
    close_rates,
    correction_of,
    factor,
    unpack,
)
from hapticmech_ros.mechanism.model import Array
from hapticmech_ros.mechanism.motion_kernels import add_point_forces, closure_bias, move_joints
from hapticmech_ros.mechanism.small_matrices import dot
from hapticmech_ros.mechanism.tables import unfold

MOST_STAGES = 4
# What a round of the projection says: on the closures, or to be moved by ``work.theta`` and seen
# again.
SETTLED, OFF = 0, 1


class Work(NamedTuple):
    """What a step works on.

    Attributes:
        settings: (4,) period (s); 1 where positions move with the rates at the step's end; φ at
            which the projection stops, and up to which it may stop when φ halves no more (m).
        scheme: (4, 2) per stage its weight, and the fraction of the step at which the next one is.
        account: (3,) work done and energy lost in the step (J), |φ| of the round before.
        q0: (nq,) configuration at the start.
        v0: (nv,) rates at the start.
        state: (nq + nv,) q and v.
        q: (nq,) configuration now.
        v: (nv,) rates now.
        theta: (nv,) change of the configuration, from q0 to the next stage or the end; or from q.
        turn: (nv,) θ̇ at this stage.
        turned: (nv,) weighted sum of θ̇.
        gained: (nv,) weighted sum of v̇.
        on_links: (nv,) joint forces of wrenches on links.
        wrenches: (points, 6) at the operational points.
    """

    settings: Array
    scheme: Array
    account: Array
    q0: Array
    v0: Array
    state: Array
    q: Array
    v: Array
    theta: Array
    turn: Array
    turned: Array
    gained: Array
    on_links: Array
    wrenches: Array


def work_size(nq: int, nv: int, points: int) -> int:
    """Return the length of an array of work."""
    return 15 + 2 * nq + 7 * nv + 6 * points


def parts_of(work: Array, nq: int, nv: int) -> Work:
    """Return the parts of an array of work, as views."""
    at = 15
    q0, v0 = work[at : at + nq], work[at + nq : at + nq + nv]
    at += nq + nv
    state = work[at : at + nq + nv]
    at += nq + nv
    vectors = work[at : at + 5 * nv].reshape(5, nv)
    wrenches = work[at + 5 * nv :]
    return Work(
        work[:4],
        work[4:12].reshape(MOST_STAGES, 2),
        work[12:15],
        q0,
        v0,
        state,
        state[:nq],
        state[nq:],
        vectors[0],
        vectors[1],
        vectors[2],
        vectors[3],
        vectors[4],
        wrenches.reshape(wrenches.size // 6, 6),
    )


_parts = inner(parts_of)


@inner
def _start(work: Work) -> None:
    work.q[:] = work.q0
    work.v[:] = work.v0
    work.turn[:] = work.v0
    work.turned[:] = 0.0
    work.gained[:] = 0.0
    work.account[0] = 0.0
    work.account[1] = 0.0
    work.account[2] = np.inf


@inner
def _aim(work: Work, weight: float, fraction: float, acceleration: Array) -> None:
    """Add a stage to the sums, and set rates and θ of the next one, or of the end."""
    period, late = work.settings[0], work.settings[1] != 0.0
    flat = work.q.size == work.v.size
    for c in range(work.v.size):
        work.turned[c] += weight * work.turn[c]
        work.gained[c] += weight * acceleration[c]
        if fraction > 0.0:
            step = fraction * period
            work.theta[c] = step * work.turn[c]
            work.v[c] = work.v0[c] + step * acceleration[c]
        else:
            work.v[c] = work.v0[c] + period * work.gained[c]
            work.theta[c] = period * (work.v[c] if late else work.turned[c])
        work.turn[c] = work.v[c]
        if flat:
            work.q[c] = work.q0[c] + work.theta[c]


@kernel(
    "int64(int64[::1], float64[::1], float64[:,::1], float64[:,::1], float64[:,::1],"
    " float64[::1], float64[::1], float64[::1], int64, boolean)"
)
def advance_stage(
    numbers: Array,
    values: Array,
    inertia: Array,
    joint_jacobian: Array,
    joint_poses: Array,
    bias_force: Array,
    packed: Array,
    work: Array,
    stage: int,
    known: bool,
) -> int:
    """Find v̇ at a stage, and go on to the next one, or to the end of the step.

    Where q is a vector, ``work.q`` is moved as well; else whoever calls does so, by ``work.theta``.

    Args:
        numbers: constants of the mechanism, whole ones.
        values: the others; see ``tables.unfold``.
        inertia: (nv, nv) D, lower triangle; this and the next two are not read where ``known``.
        joint_jacobian: (nv, 6) world axes, at the world's origin.
        joint_poses: (joints, 12).
        bias_force: (nv,) h.
        packed: terms of the stage's configuration: to read where ``known``, else to fill.
        work: see :class:`Work`.
        stage: its number; 0 starts from ``q0`` and ``v0``.
        known: whether ``packed`` is filled.

    Returns:
        0, or a negative code; see ``factor_closures``, and NOT_FINITE rates.
    """
    tables = unfold(numbers, values)
    nv, m = tables.nv, tables.m
    parts = _parts(work, tables.nq, nv)
    if stage == 0:
        _start(parts)
    if not np.isfinite(dot(parts.v, parts.v)):
        return NOT_FINITE
    space = unpack(packed, nv, m)
    if not known:
        code = factor(tables, inertia, joint_jacobian, joint_poses, space)
        if code < 0:
            return code
    motions = np.empty((tables.joints.shape[0], 12))
    bias, passive, result = np.empty(m), np.empty(nv), np.empty(nv + m)
    if m > 0:
        move_joints(tables, space, parts.v, motions)
        closure_bias(tables, space, motions, bias)
    result[:nv] = parts.on_links
    add_point_forces(tables, space, parts.wrenches, result)
    for c in range(nv):
        passive[c] = -tables.damping[c] * parts.v[c]
    weight, fraction = parts.scheme[stage, 0], parts.scheme[stage, 1]
    parts.account[0] += weight * parts.settings[0] * dot(result[:nv], parts.v)
    parts.account[1] -= weight * parts.settings[0] * dot(passive, parts.v)
    accelerate(space, int(space.tail[1]), bias_force, passive, bias, result)
    _aim(parts, weight, fraction, result)
    return 0


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
    """Do one round of the projection at ``work.q``.

    Returns:
        SETTLED: ``work.v`` is tangent to the closures. OFF: ``work.theta`` leads towards them, and
        ``work.q`` is moved where it is a vector. Else a negative code; see ``factor_closures``, and
        NOT_FINITE states.
    """
    tables = unfold(numbers, values)
    parts = _parts(work, tables.nq, tables.nv)
    if not np.isfinite(dot(parts.q, parts.q) + dot(parts.v, parts.v)):
        return NOT_FINITE
    space = unpack(packed, tables.nv, tables.m)
    rank = factor(tables, inertia, joint_jacobian, joint_poses, space)
    if rank < 0 or tables.m == 0:
        return rank
    worst, before = space.tail[0], parts.account[2]
    rounding = worst <= parts.settings[3] and worst > 0.5 * before
    if worst <= parts.settings[2] or rounding:
        close_rates(space, rank, parts.v)
        return SETTLED
    parts.account[2] = worst
    correction_of(space, rank, space.residual, parts.theta)
    for c in range(tables.nv):
        parts.theta[c] = -parts.theta[c]
        if tables.nq == tables.nv:
            parts.q[c] += parts.theta[c]
    return OFF
