# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Kernel of all that rendering needs of an operational point: terms, analysis, delay, motion.

Beside it: the number of joint constraints, by a Schmitt trigger with dwell on each s_i; rates of a
mechanism's last states, by their stamps; and what contacts do at an operational point, in the
dynamically consistent sense.

    F_c = J̄ᵀ Σ J_cᵀ λ,      J̄ = D⁻¹ P J_hᵀ X⁺

is the wrench at the point that accelerates it as the contacts do: X F_c = a_c. Along directions
that the joints constrain (weight w(s_i) of 1) no wrench does, and F_c has no part there.
"""

from __future__ import annotations

import numpy as np

from hapticmech_ros.arrays import Array
from hapticmech_ros.compilation import inner, kernel, local, put, shaped
from hapticmech_ros.layout import OPERATIONAL_MODEL, Field, Layout
from hapticmech_ros.mechanism.kernels.element_kernels import element_forces
from hapticmech_ros.mechanism.kernels.factor_kernels import factor
from hapticmech_ros.mechanism.kernels.metric_kernels import free_part, from_metric, to_metric
from hapticmech_ros.mechanism.kernels.model import Model, unpack
from hapticmech_ros.mechanism.kernels.motion_kernels import closure_bias, move_joints, move_point
from hapticmech_ros.mechanism.kernels.small_matrices import dot
from hapticmech_ros.mechanism.kernels.tree_kernels import bias_force_of
from hapticmech_ros.operational.kernels import (
    ANALYSIS_SIZE,
    FREE,
    SQUARES,
    analyse_motion,
    compensate,
    metric_of,
)
from hapticmech_ros.rotation_kernels import quaternion_of

# Of the analysis alone; a negative code of the closures is one of ``factor_closures``.
NO_SPECTRUM = 1
CONTACT, MODEL_SIZE = OPERATIONAL_MODEL.start("contact"), OPERATIONAL_MODEL.size
# In an observation: X and a_0 as they are now, and then weights and directions.
DETAILS = MODEL_SIZE + 42


@kernel(
    "int64(int64[::1], float64[::1], float64[::1], int64, float64[::1], float64[::1], int64,"
    " float64[::1], int64[::1], float64, float64, float64[::1], float64[::1], float64[::1])",
    linked=True,
)
def observe_point(
    numbers: Array,
    values: Array,
    packed: Array,
    known: int,
    q: Array,
    v: Array,
    index: int,
    constants: Array,
    rows: Array,
    length: float,
    delay: float,
    before: Array,
    ahead: Array,
    observation: Array,
) -> int:
    """Evaluate Eq. 1 at a state and analyse an operational point there.

    Args:
        numbers: (integers,) constants of the mechanism, whole ones.
        values: (numbers,) the others; see ``model.pack``.
        packed: (size,) packed terms at the configuration; filled first, unless they are known.
        known: whether they are.
        q: (nq,) configuration.
        v: (nv,) rates.
        index: number of the operational point.
        constants: (numbers,) of the analysis; see ``metric_of``.
        rows: (t,) rows of a six-vector that the task space has.
        length: of the mechanism, m.
        delay: τ of the loop, s; 0 for none.
        before: (1 + nv,) rates that were, and before them how long ago, s; 0 if unknown.
        ahead: (size,) as long as ``packed``, to work in.
        observation: (numbers,) to fill; see ``observation_layout``. F_c is zero.

    Returns:
        0; NO_SPECTRUM where the SVD of S does not converge; or a negative code.
    """
    model, metric = Model(numbers, values), metric_of(constants, rows.size)
    data = unpack(packed, model)
    nv, t = model.nv, rows.size
    if known == 0:
        code = factor(model, q, data)
        if code < 0:
            return code
    motions, bias, forces = model.motions, model.bias, model.forces
    bias_force, passive, dissipative = forces[0], forces[1], forces[2]
    move_joints(model, data, v, motions)
    bias_force_of(model, data, motions, bias_force)
    closure_bias(model, data, v, motions, bias)
    element_forces(model, data, q, v, passive, dissipative)
    for c in range(nv):
        passive[c] += model.effort[c]
    operational_model, now = observation[:MODEL_SIZE], observation[MODEL_SIZE:DETAILS]
    details = observation[DETAILS : DETAILS + t * (1 + 2 * t)]
    at = DETAILS + t * (1 + 2 * t)
    jacobian = shaped(observation[at:], (6, nv))
    motion = observation[at + 6 * nv : at + 6 * nv + 12]
    move_point(model, data, motions, index, jacobian, motion)
    pose = data.poses[model.points[index]]
    rotation = shaped(pose[:9], (3, 3)).T
    converged = analyse_motion(
        model,
        data,
        bias_force,
        passive,
        bias,
        jacobian,
        motion[6:],
        rotation,
        metric,
        rows,
        operational_model[:ANALYSIS_SIZE],
        details,
    )
    if not converged:
        return NO_SPECTRUM
    put(now[:36], operational_model[SQUARES : SQUARES + 36])
    put(now[36:], operational_model[FREE:ANALYSIS_SIZE])
    place = operational_model[ANALYSIS_SIZE:CONTACT]
    put(place[:3], pose[9:])
    quaternion_of(rotation, place[3:7])
    put(place[7:13], motion[:6])
    operational_model[CONTACT:] = 0.0
    if delay > 0.0:
        compensated = local(42)
        put(compensated[36:], now[36:])
        compensate(
            model,
            data,
            q,
            v,
            bias_force,
            passive,
            bias,
            jacobian,
            index,
            rows,
            operational_model[:t],
            details,
            length,
            delay,
            before,
            ahead,
            compensated,
        )
        put(operational_model[SQUARES : SQUARES + 36], compensated[:36])
        put(operational_model[FREE:ANALYSIS_SIZE], compensated[36:])
    return 0


ONE, SIX = Field(1), Field(6)
# Thresholds; dwell, s; 1 once s has been seen; per direction, s descending, 1 if it is reported as
# rigid, and since when s disagrees, s, NaN if it does not.
COUNTER = Layout(
    {**dict.fromkeys(("s_on", "s_off", "dwell", "begun"), ONE), "rigid": SIX, "since": SIX}
)
S_ON, S_OFF, DWELL, BEGUN, RIGID, SINCE = COUNTER.starts(*COUNTER)
# Absorbs the rounding of times that are sums of periods, s.
ROUNDING = 5e-10


@inner
def count_rigid(counter: Array, s: Array, time: float) -> int:
    """Return how many directions are reported as rigid; see :func:`count_constraints`."""
    count = 0
    for i in range(s.size):
        was_rigid = counter[RIGID + i] != 0.0
        if counter[BEGUN] == 0.0:
            was_rigid = bool(s[i] <= counter[S_ON])
            counter[SINCE + i] = np.nan
        disagrees = s[i] >= counter[S_OFF] if was_rigid else s[i] <= counter[S_ON]
        if not disagrees:
            counter[SINCE + i] = np.nan
        elif np.isnan(counter[SINCE + i]):
            counter[SINCE + i] = time
        if disagrees and time - counter[SINCE + i] >= counter[DWELL] - ROUNDING:
            was_rigid = not was_rigid
            counter[SINCE + i] = np.nan
        counter[RIGID + i] = 1.0 if was_rigid else 0.0
        count += int(was_rigid)
    counter[BEGUN] = 1.0
    return count


@kernel("int64(float64[::1], float64[::1], float64)")
def count_constraints(counter: Array, s: Array, time: float) -> int:
    """Return how many directions are reported as rigid, once s was seen at ``time``.

    Args:
        counter: (numbers,) a :data:`COUNTER`, changed.
        s: (t,) singular values, descending.
        time: s.
    """
    return count_rigid(counter, s, time)


# Of the numbers that go with the states: how many states there are, the row of the newest one, how
# long before a state the rates are wanted, ns, and by how much that may be missed to either side.
COUNT, NEWEST, WANTED, MISSING, FARTHEST = range(5)
PAST_SIZE = 5


@inner
def rates_before(past: Array, stamps: Array, rates: Array, stamp: int, before: Array) -> None:
    """Fill (1 + nv,) how long before a time, s, and the rates that were; zeros if unknown.

    Args:
        past: (5,) whole numbers, see above.
        stamps: (states,) ns.
        rates: (states, nv) rad/s or m/s.
        stamp: the time, ns.
        before: (1 + nv,) to fill.
    """
    before[:] = 0.0
    for back in range(past[COUNT]):
        row = (past[NEWEST] - back) % stamps.size
        age = stamp - stamps[row]
        if age > past[FARTHEST]:
            return
        if age >= past[WANTED] - past[MISSING]:
            before[0] = age / 1e9
            put(before[1:], rates[row])
            return


@inner
def remember_state(past: Array, stamps: Array, rates: Array, stamp: int, v: Array) -> None:
    """Remember the rates of a state.

    Args:
        past: (5,) whole numbers, changed.
        stamps: (states,) ns, changed.
        rates: (states, nv) rad/s or m/s, changed.
        stamp: of the state, ns; not before that of the one before, or those are forgotten.
        v: (nv,) its rates.
    """
    if past[COUNT] > 0 and stamp < stamps[past[NEWEST]]:
        past[COUNT] = 0
    if past[WANTED] == 0:
        return
    past[NEWEST] = (past[NEWEST] + 1) % stamps.size
    past[COUNT] = min(past[COUNT] + 1, stamps.size)
    stamps[past[NEWEST]] = stamp
    put(rates[past[NEWEST]], v)


@kernel(
    "void(int64[::1], float64[::1], float64[::1], float64[::1], int64[::1], float64[::1],"
    " float64[::1])",
    linked=True,
)
def consistent_wrench(
    numbers: Array,
    values: Array,
    packed: Array,
    observation: Array,
    rows: Array,
    joint_force: Array,
    wrench: Array,
) -> None:
    """Fill F_c = Σ (1 - w_i) n_i (n_iᵀ a_c) / μ_i, as X n_i = μ_i I_ℓ⁻¹ n_i; T18 of derivations.md.

    Args:
        numbers: (integers,) constants of the mechanism, whole ones.
        values: (numbers,) the others; see ``model.pack``.
        packed: (size,) packed terms at the configuration.
        observation: (numbers,) of the point there; see ``observation_layout``.
        rows: (t,) rows of a six-vector that the task space has.
        joint_force: (nv,) Σ J_cᵀ λ, N m or N.
        wrench: (6,) F_c to fill, N and N m, world axes at the point.
    """
    model, t = Model(numbers, values), rows.size
    data, nv = unpack(packed, model), model.nv
    rates, acceleration = local(nv), local(6)
    put(rates, joint_force)
    to_metric(model, data, rates)
    free_part(model, data, rates)
    from_metric(model, data, rates)
    weights, at = observation[DETAILS : DETAILS + t], DETAILS + t * (1 + 2 * t)
    directions = shaped(observation[DETAILS + t :], (t, t))
    jacobian = shaped(observation[at:], (6, nv))
    for r in range(6):
        acceleration[r], wrench[r] = dot(jacobian[r], rates), 0.0
    for i in range(t):
        if weights[i] < 1.0:
            along = 0.0
            for r in range(t):
                along += directions[r, i] * acceleration[rows[r]]
            share = (1.0 - weights[i]) * along / (observation[i] * observation[i])
            for r in range(t):
                wrench[rows[r]] += directions[r, i] * share
