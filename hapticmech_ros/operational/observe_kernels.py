# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Kernel of all that rendering needs of an operational point: terms, analysis, delay, motion."""

from __future__ import annotations

from hapticmech_ros.arrays import Array
from hapticmech_ros.compilation import kernel, local, put, shaped
from hapticmech_ros.layout import OPERATIONAL_MODEL
from hapticmech_ros.mechanism.kernels.data import unpack
from hapticmech_ros.mechanism.kernels.element_kernels import element_forces
from hapticmech_ros.mechanism.kernels.factor_kernels import factor
from hapticmech_ros.mechanism.kernels.model import Model
from hapticmech_ros.mechanism.kernels.motion_kernels import closure_bias, move_joints, move_point
from hapticmech_ros.mechanism.kernels.tree_kernels import bias_force_of
from hapticmech_ros.operational.delay_compensation_kernels import compensate
from hapticmech_ros.operational.kernels import (
    ANALYSIS_SIZE,
    FREE,
    SQUARES,
    analyse_motion,
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
