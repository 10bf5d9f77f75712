# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Kernel of what contacts do at an operational point, in the dynamically consistent sense.

    F_c = J̄ᵀ Σ J_cᵀ λ,      J̄ = D⁻¹ P J_hᵀ X⁺

is the wrench at the point that accelerates it as the contacts do: X F_c = a_c. Along directions
that the joints constrain (weight w(s_i) of 1) no wrench does, and F_c has no part there.
"""

from __future__ import annotations

from hapticmech_ros.arrays import Array
from hapticmech_ros.compilation import kernel, local, put, shaped
from hapticmech_ros.mechanism.kernels.data import unpack
from hapticmech_ros.mechanism.kernels.metric_kernels import free_part, from_metric, to_metric
from hapticmech_ros.mechanism.kernels.model import Model
from hapticmech_ros.mechanism.kernels.small_matrices import dot
from hapticmech_ros.operational.observe_kernels import DETAILS


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
