"""A step of the mechanism inside a kernel: the work that its parts share, and explicit stages.

What :mod:`~hapticmech_ros.mechanism.integrator` says in plain NumPy, on one array of work.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from hapticmech_ros.compilation import inner
from hapticmech_ros.mechanism.compiled.element_kernels import element_forces
from hapticmech_ros.mechanism.compiled.manifold_kernels import local_rates, move
from hapticmech_ros.mechanism.compiled.metric_kernels import accelerate
from hapticmech_ros.mechanism.compiled.motion_kernels import (
    add_link_forces,
    add_point_forces,
    closure_bias,
    move_joints,
)
from hapticmech_ros.mechanism.compiled.packed import Packed
from hapticmech_ros.mechanism.compiled.pair_kernels import pair_power
from hapticmech_ros.mechanism.compiled.small_matrices import dot
from hapticmech_ros.mechanism.compiled.tables import Tables
from hapticmech_ros.mechanism.compiled.tree_kernels import bias_force_of
from hapticmech_ros.mechanism.model import Array

MOST_STAGES = 4
_SETTINGS, _ACCOUNT = 9, 6
_HEAD = _SETTINGS + 2 * MOST_STAGES + _ACCOUNT


class Work(NamedTuple):
    """What a step works on.

    Attributes:
        settings: (9,) step (s); 1 where positions move with the rates at the step's end; φ at which
            the projection stops, up to which it may stop when φ halves no more, and beyond which a
            step may have been a jump (m); Baumgarte's rate a (1/s), 0 for the projection; φ beyond
            which a loop has come apart (m); 1 where θ̇ differs from v at later stages; 1 to end a
            run where a step needs care.
        scheme: (4, 2) per stage its weight, and the fraction of the step at which the next one is.
        account: (6,) work done and energy lost since the run began (J), |φ| of the round before,
            in the mass metric how far the step went, if it may have been a jump, and the
            projection; and the number of steps done.
        q0: (nq,) configuration at the start.
        v0: (nv,) rates at the start.
        state: (nq + nv,) q and v.
        q: (nq,) configuration now.
        v: (nv,) rates now.
        theta: (nv,) change of the configuration, from q0 to the next stage or the end; or from q.
        turn: (nv,) θ̇ at this stage.
        turned: (nv,) weighted sum of θ̇.
        gained: (nv,) weighted sum of v̇.
        held: (nv,) joint forces from outside.
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
    held: Array
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
    work.account[2] = np.inf
    work.account[3] = np.inf
    work.account[4] = 0.0


@inner
def find_rates(
    tables: Tables, space: Packed, parts: Work, weight: float, pushes: Array, result: Array
) -> None:
    """Fill ``result`` (nv + m,) with v̇ and λ at ``parts.q`` and ``parts.v``.

    ``space`` has been filled there. ``weight`` times its powers goes to the account.
    """
    nv, m = tables.nv, tables.m
    bias, forces = np.empty(m), np.empty((3, nv))
    motions = np.empty((tables.joints.shape[0], 12))
    move_joints(tables, space, parts.v, motions)
    passive, dissipative, bias_force = forces[0], forces[1], forces[2]
    bias_force_of(tables, space, motions, bias_force)
    if m > 0:
        closure_bias(tables, space, motions, bias)
        if parts.settings[5] > 0.0:
            _pull(tables, space, parts, bias)
    element_forces(tables, space, parts.q, parts.v, passive, dissipative)
    for c in range(nv):
        result[c] = parts.held[c] + tables.effort[c]
    add_point_forces(tables, space, parts.wrenches, result)
    add_link_forces(tables, space, pushes, result)
    step = weight * parts.settings[0]
    parts.account[0] += step * dot(result[:nv], parts.v)
    parts.account[1] -= step * dot(dissipative, parts.v)
    accelerate(tables, space, bias_force, passive, bias, result)


@inner
def _pull(tables: Tables, space: Packed, parts: Work, bias: Array) -> None:
    """Add Baumgarte's pull 2a W v + a² φ to ``bias`` (m,)."""
    pull, axes = parts.settings[5], space.joint_jacobian
    for index in range(tables.closures.shape[0]):
        _, a, b, first = tables.closures[index]
        end = tables.m
        if index + 1 < tables.closures.shape[0]:
            end = tables.closures[index + 1, 3]
        joint_a, joint_b = tables.carriers[a], tables.carriers[b]
        for i in range(first, end):
            pair = space.wrenches[i]
            speed = pair_power(tables.joints, axes, joint_a, joint_b, pair, parts.v)
            bias[i] += 2.0 * pull * speed + pull * pull * space.residual[i]


@inner
def aim(tables: Tables, work: Work, weight: float, fraction: float, acceleration: Array) -> None:
    """Add an explicit stage to the sums, and set q, v and θ̇ of the next one, or of the end."""
    period, late = work.settings[0], work.settings[1] != 0.0
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
    follow(tables, work)


@inner
def follow(tables: Tables, work: Work) -> None:
    """Set q and θ̇ from θ and v."""
    flat = work.q.size == work.v.size
    for c in range(work.v.size):
        work.turn[c] = work.v[c]
        if flat:
            work.q[c] = work.q0[c] + work.theta[c]
    if not flat:
        move(tables, work.q0, work.theta, work.q)
        if work.settings[7] != 0.0:
            local_rates(tables, work.theta, work.v, work.turn)
