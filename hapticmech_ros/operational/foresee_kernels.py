"""Kernel of what a mechanism does by itself where it will be: see :mod:`.late_answer`."""

from __future__ import annotations

import numpy as np

from hapticmech_ros.arrays import Array
from hapticmech_ros.compilation import inner, local, shaped
from hapticmech_ros.mechanism.kernels.element_kernels import element_forces
from hapticmech_ros.mechanism.kernels.factor_kernels import factor
from hapticmech_ros.mechanism.kernels.manifold_kernels import move
from hapticmech_ros.mechanism.kernels.metric_kernels import accelerate, correction_of
from hapticmech_ros.mechanism.kernels.motion_kernels import closure_bias, move_joints, move_point
from hapticmech_ros.mechanism.kernels.packed import Packed, unpack
from hapticmech_ros.mechanism.kernels.small_matrices import dot_with_row
from hapticmech_ros.mechanism.kernels.tables import SPARSE, Tables
from hapticmech_ros.mechanism.kernels.tree_kernels import bias_force_of

# Off the closures by φ, at a relative singular value σ, free rates turn by φ/σ²: by no more than
# this share of the length, or what is foreseen is not used.
TRUSTED = 0.01


@inner
def _least(tables: Tables, space: Packed) -> float:
    """Return σ_r / σ_1; of R's diagonal, where the factorisation is sparse."""
    rank = int(space.tail[1])
    if rank == 0:
        return 1.0
    if tables.path != SPARSE:
        return float(space.sigma[rank - 1] / space.sigma[0])
    smallest, largest = np.inf, 0.0
    for row in range(tables.m):
        if space.row_places[row, 1] >= 0.0:
            pivot = abs(1.0 / space.row_places[row, 2])
            smallest, largest = min(smallest, pivot), max(largest, pivot)
    return smallest / largest


@inner
def _trusted(tables: Tables, space: Packed, before: Packed, length: float) -> bool:
    """Return whether closures at a foreseen configuration say what they said before."""
    if space.tail[1] != before.tail[1]:
        return False
    return bool(space.tail[0] <= TRUSTED * _least(tables, space) ** 2 * length)


@inner
def foresee(
    tables: Tables,
    space: Packed,
    q: Array,
    v: Array,
    bias: Array,
    index: int,
    length: float,
    lateness: float,
    ahead: Array,
    own: Array,
    free: Array,
) -> None:
    """Replace v̇_0 and a_0 by those at the configuration after τ, where it can be trusted.

    The tables' room to work in, what moves and forces there, is of that configuration afterwards.

    Args:
        tables: the mechanism's.
        space: terms at the configuration.
        q: (nq,) configuration.
        v: (nv,) rates.
        bias: (m,) Ẇv.
        index: number of the operational point.
        length: of the mechanism, m.
        lateness: τ, s.
        ahead: to fill with terms at the configuration after τ.
        own: (nv + m,) v̇_0 and λ.
        free: (6,) a_0.
    """
    nv = tables.nv
    change, place = local(nv), local(q.size)
    correction_of(tables, space, bias, change)
    for c in range(nv):
        change[c] = lateness * v[c] - 0.5 * lateness * lateness * change[c]
    move(tables, q, change, place)
    later = unpack(ahead, tables)
    if factor(tables, place, later) < 0 or not _trusted(tables, later, space, length):
        return
    motions, bias_force, passive = tables.motions, tables.forces[0], tables.forces[1]
    move_joints(tables, later, v, motions)
    bias_force_of(tables, later, motions, bias_force)
    closure_bias(tables, later, motions, tables.bias)
    element_forces(tables, later, place, v, passive, tables.forces[2])
    for c in range(nv):
        passive[c] += tables.effort[c]
    jacobian, motion = shaped(local(6 * nv), (6, nv)), local(12)
    move_point(tables, later, motions, index, jacobian, motion)
    own[:] = 0.0
    accelerate(tables, later, bias_force, passive, tables.bias, own)
    for i in range(6):
        free[i] = dot_with_row(jacobian, i, own[:nv]) + motion[6 + i]
