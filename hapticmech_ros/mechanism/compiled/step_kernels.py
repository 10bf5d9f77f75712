"""A step of the mechanism by kernels: the work that they share, and a stage of explicit rules.

What :mod:`~hapticmech_ros.mechanism.integrator` says in plain NumPy, on one array of work. Between
two calls Pinocchio computes D, h, joint Jacobians and poses at ``work.q`` and ``work.v``.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from hapticmech_ros.compilation import inner, kernel
from hapticmech_ros.mechanism.compiled.element_kernels import element_forces
from hapticmech_ros.mechanism.compiled.kernels import NOT_FINITE, accelerate, factor
from hapticmech_ros.mechanism.compiled.motion_kernels import (
    add_point_forces,
    closure_bias,
    move_joints,
)
from hapticmech_ros.mechanism.compiled.packed import Packed, unpack
from hapticmech_ros.mechanism.compiled.small_matrices import dot, dot_with_row
from hapticmech_ros.mechanism.compiled.tables import Tables, unfold
from hapticmech_ros.mechanism.model import Array

MOST_STAGES = 4
_SETTINGS, _ACCOUNT = 6, 5
_HEAD = _SETTINGS + 2 * MOST_STAGES + _ACCOUNT


class Work(NamedTuple):
    """What a step works on.

    Attributes:
        settings: (6,) period (s); 1 where positions move with the rates at the step's end; φ at
            which the projection stops, up to which it may stop when φ halves no more, and beyond
            which a step may have been a jump (m); Baumgarte's rate a (1/s), 0 for the projection.
        scheme: (4, 2) per stage its weight, and the fraction of the step at which the next one is.
        account: (5,) work done and energy lost in the step (J), |φ| of the round before, and in the
            mass metric how far the step went, if it may have been a jump, and the projection.
        q0: (nq,) configuration at the start.
        v0: (nv,) rates at the start.
        state: (nq + nv,) q and v.
        q: (nq,) configuration now.
        v: (nv,) rates now.
        theta: (nv,) change of the configuration, from q0 to the next stage or the end; or from q.
        turn: (nv,) θ̇ at this stage.
        turned: (nv,) weighted sum of θ̇.
        gained: (nv,) weighted sum of v̇.
        on_links: (nv,) joint forces of wrenches on links, and further ones.
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
    return _HEAD + 2 * nq + 7 * nv + 6 * points


def parts_of(work: Array, nq: int, nv: int) -> Work:
    """Return the parts of an array of work, as views."""
    at = _HEAD
    q0, v0 = work[at : at + nq], work[at + nq : at + nq + nv]
    at += nq + nv
    state = work[at : at + nq + nv]
    at += nq + nv
    vectors = work[at : at + 5 * nv].reshape(5, nv)
    wrenches = work[at + 5 * nv :]
    return Work(
        work[:_SETTINGS],
        work[_SETTINGS : _HEAD - _ACCOUNT].reshape(MOST_STAGES, 2),
        work[_HEAD - _ACCOUNT : _HEAD],
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


step_parts = inner(parts_of)


@inner
def start_step(work: Work) -> None:
    """Go to the step's start, with nothing summed."""
    work.q[:] = work.q0
    work.v[:] = work.v0
    work.turn[:] = work.v0
    work.turned[:] = 0.0
    work.gained[:] = 0.0
    work.account[0] = 0.0
    work.account[1] = 0.0
    work.account[2] = np.inf
    work.account[3] = np.inf
    work.account[4] = 0.0


@inner
def find_rates(
    tables: Tables, space: Packed, parts: Work, weight: float, bias_force: Array, result: Array
) -> None:
    """Fill ``result`` (nv + m,) with v̇ and λ at ``parts.q`` and ``parts.v``.

    ``space`` has been filled there. ``weight`` times its powers goes to the account.
    """
    nv, m = tables.nv, tables.m
    bias, forces = np.empty(m), np.empty((2, nv))
    if m > 0:
        motions = np.empty((tables.joints.shape[0], 12))
        move_joints(tables, space, parts.v, motions)
        closure_bias(tables, space, motions, bias)
        pull = parts.settings[5]
        if pull > 0.0:
            for i in range(m):
                bias[i] += 2.0 * pull * dot_with_row(space.jacobian, i, parts.v)
                bias[i] += pull * pull * space.residual[i]
    passive, dissipative = forces[0], forces[1]
    element_forces(tables, space, parts.q, parts.v, passive, dissipative)
    for c in range(nv):
        result[c] = parts.on_links[c] + tables.effort[c]
    add_point_forces(tables, space, parts.wrenches, result)
    step = weight * parts.settings[0]
    parts.account[0] += step * dot(result[:nv], parts.v)
    parts.account[1] -= step * dot(dissipative, parts.v)
    accelerate(space, int(space.tail[1]), bias_force, passive, bias, result)


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
    parts = step_parts(work, tables.nq, nv)
    if stage == 0:
        start_step(parts)
    if not np.isfinite(dot(parts.v, parts.v)):
        return NOT_FINITE
    space = unpack(packed, nv, m)
    if not known:
        code = factor(tables, inertia, joint_jacobian, joint_poses, space)
        if code < 0:
            return code
    weight, fraction = parts.scheme[stage, 0], parts.scheme[stage, 1]
    result = np.empty(nv + m)
    find_rates(tables, space, parts, weight, bias_force, result)
    _aim(parts, weight, fraction, result)
    return 0
