# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The predicted state q', and free accelerations there; see :mod:`.delay_compensation`."""

from __future__ import annotations

from hapticmech_ros.arrays import Array
from hapticmech_ros.compilation import inner, local, shaped
from hapticmech_ros.mechanism.kernels.data import Data, unpack
from hapticmech_ros.mechanism.kernels.element_kernels import element_forces
from hapticmech_ros.mechanism.kernels.factor_kernels import factor
from hapticmech_ros.mechanism.kernels.manifold_kernels import move
from hapticmech_ros.mechanism.kernels.metric_kernels import accelerate, correction_of
from hapticmech_ros.mechanism.kernels.model import SPARSE, Model
from hapticmech_ros.mechanism.kernels.motion_kernels import closure_bias, move_joints, move_point
from hapticmech_ros.mechanism.kernels.small_matrices import dot_with_row
from hapticmech_ros.mechanism.kernels.step_layout import ERROR, LEAST, RANK
from hapticmech_ros.mechanism.kernels.tree_kernels import bias_force_of

# Off the closures by φ, at a relative singular value σ, free rates turn by φ/σ²: by no more than
# this share of the length, or the prediction is not used.
TRUSTED = 0.01


@inner
def _least(model: Model, data: Data) -> float:
    """Return σ_r / σ_1; an estimate from above, where the factorisation is sparse."""
    rank = int(data.tail[RANK])
    if rank == 0:
        return 1.0
    if model.path == SPARSE:
        return float(data.tail[LEAST])
    return float(data.sigma[rank - 1] / data.sigma[0])


@inner
def _trusted(model: Model, data: Data, before: Data, length: float) -> bool:
    """Return whether closures at a predicted configuration are as well resolved as before."""
    if data.tail[RANK] != before.tail[RANK]:
        return False
    return bool(data.tail[ERROR] <= TRUSTED * _least(model, data) ** 2 * length)


@inner
def predict(
    model: Model,
    data: Data,
    q: Array,
    v: Array,
    bias: Array,
    index: int,
    length: float,
    compensated_delay: float,
    ahead: Array,
    own: Array,
    free: Array,
) -> None:
    """Replace v̇_0 and a_0 by those at the configuration after τ, where it can be trusted.

    The model's workspace, what moves and forces there, is of that configuration afterwards.

    Args:
        model: the mechanism's.
        data: terms at the configuration.
        q: (nq,) configuration.
        v: (nv,) rates.
        bias: (m,) Ẇv.
        index: number of the operational point.
        length: of the mechanism, m.
        compensated_delay: τ, s.
        ahead: to fill with terms at the configuration after τ.
        own: (nv + m,) v̇_0 and λ.
        free: (6,) a_0.
    """
    nv = model.nv
    change, place = local(nv), local(q.size)
    correction_of(model, data, bias, change)
    for c in range(nv):
        change[c] = (
            compensated_delay * v[c] - 0.5 * compensated_delay * compensated_delay * change[c]
        )
    move(model, q, change, place)
    later = unpack(ahead, model)
    if factor(model, place, later) < 0 or not _trusted(model, later, data, length):
        return
    motions, bias_force, passive = model.motions, model.forces[0], model.forces[1]
    move_joints(model, later, v, motions)
    bias_force_of(model, later, motions, bias_force)
    closure_bias(model, later, v, motions, model.bias)
    element_forces(model, later, place, v, passive, model.forces[2])
    for c in range(nv):
        passive[c] += model.effort[c]
    jacobian, motion = shaped(local(6 * nv), (6, nv)), local(12)
    move_point(model, later, motions, index, jacobian, motion)
    own[:] = 0.0
    accelerate(model, later, bias_force, passive, model.bias, own)
    for i in range(6):
        free[i] = dot_with_row(jacobian, i, own[:nv]) + motion[6 + i]
