# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""D = L Lᵀ without D: articulated inertias instead of a Cholesky factor, linear in the joints.

Going from the tips to the world, each rate c leaves its axis S_c, U_c = I S_c and d_c = S_cᵀU_c of
the articulated inertia I that it carries, and I - U_c U_cᵀ/d_c goes on (Featherstone, Rigid Body
Dynamics Algorithms, 7.3). The inertia of a rotor is added to d_c alone (9.6 there). The same
numbers are a factor of D: Rodriguez, Jain and Kreutz-Delgado (1992) call it innovations
factorisation. L⁻¹, L⁻ᵀ and Lᵀ are a sweep each. All are about the world's origin and need no
transforms from joint to joint.
"""

from __future__ import annotations

import numpy as np

from hapticmech_ros.compilation import inner, leaf, shaped
from hapticmech_ros.mechanism.kernels.model import Data, Model
from hapticmech_ros.mechanism.kernels.tree_kernels import ARMATURE
from hapticmech_ros.numerics import Array
from hapticmech_ros.numerics.small_matrices import clear, dot6


@inner
def articulate(model: Model, data: Data) -> int:
    """Fill ``data.pivots``; return the first rate that moves no mass, or -1."""
    joints, axes, pivots = model.joints, data.joint_jacobian, data.pivots
    sweep, bodies = model.sweep, data.bodies
    clear(sweep, 36)
    carried = shaped(sweep, (joints.shape[0], 6, 6))
    for joint in range(joints.shape[0] - 1, 0, -1):
        inertia = carried[joint]
        _add_body(bodies[joint], inertia)
        for row in range(joints[joint, 1] + joints[joint, 2] - 1, joints[joint, 1] - 1, -1):
            found = pivots[row]
            for i in range(6):
                found[i] = dot6(inertia[i], axes[row])
            pivot = dot6(axes[row], found) + model.joint_values[joint, ARMATURE]
            if not pivot > 0.0:
                return int(row)
            root = np.sqrt(pivot)
            inverse = 1.0 / root
            found[6], found[7] = root, inverse
            for i in range(6):
                found[i] *= inverse
            for i in range(6):
                for j in range(6):
                    inertia[i, j] -= found[i] * found[j]
        parent = joints[joint, 0]
        if parent > 0:
            for i in range(6):
                for j in range(6):
                    carried[parent, i, j] += inertia[i, j]
    return -1


@leaf
def _add_body(body: Array, inertia: Array) -> None:
    """Add a body's (6, 6) map from twist to momentum."""
    for i in range(3):
        inertia[i, i] += body[0]
    x, y, z = body[1], body[2], body[3]
    inertia[0, 4] += z
    inertia[0, 5] -= y
    inertia[1, 3] -= z
    inertia[1, 5] += x
    inertia[2, 3] += y
    inertia[2, 4] -= x
    inertia[4, 0] += z
    inertia[5, 0] -= y
    inertia[3, 1] -= z
    inertia[5, 1] += x
    inertia[3, 2] += y
    inertia[4, 2] -= x
    at = 4
    for i in range(3, 6):
        for j in range(i, 6):
            inertia[i, j] += body[at]
            if j > i:
                inertia[j, i] += body[at]
            at += 1


@inner
def force_to_metric(model: Model, data: Data, vector: Array) -> None:
    """Replace joint forces (nv,) by L⁻¹ of them."""
    joints, axes, pivots = model.joints, data.joint_jacobian, data.pivots
    wrenches = model.sweep
    clear(wrenches, 6)
    for joint in range(joints.shape[0] - 1, 0, -1):
        wrench = wrenches[joint]
        for row in range(joints[joint, 1] + joints[joint, 2] - 1, joints[joint, 1] - 1, -1):
            left = (vector[row] - dot6(axes[row], wrench)) * pivots[row, 7]
            vector[row] = left
            for i in range(6):
                wrench[i] += pivots[row, i] * left
        parent = joints[joint, 0]
        for i in range(6):
            wrenches[parent, i] += wrench[i]


@inner
def sweep_outwards(model: Model, data: Data, vector: Array, from_rates: bool) -> None:
    """Replace joint rates v (nv,) by y = Lᵀv, in the mass metric; or y by v, L⁻ᵀ y.

    From the world to the tips with twists, where v_c √d_c = y_c - U_c·twist / √d_c.
    """
    joints, axes, pivots = model.joints, data.joint_jacobian, data.pivots
    twists = model.sweep
    for i in range(6):
        twists[0, i] = 0.0
    for joint in range(1, joints.shape[0]):
        twist, parent = twists[joint], twists[joints[joint, 0]]
        for i in range(6):
            twist[i] = parent[i]
        for row in range(joints[joint, 1], joints[joint, 1] + joints[joint, 2]):
            rate, carried = vector[row], dot6(pivots[row], twist)
            if from_rates:
                vector[row] = pivots[row, 6] * rate + carried
            else:
                rate = (rate - carried) * pivots[row, 7]
                vector[row] = rate
            for i in range(6):
                twist[i] += axes[row, i] * rate


@inner
def pair_to_metric(
    model: Model, data: Data, a: int, b: int, pair: Array, scale: float, column: Array
) -> None:
    """Fill L⁻¹ of the joint forces of a pair (see ``closure_kernels``), times ``scale``.

    ``column`` is filled at the places that ``model.order`` gives the rates of joints a, b and
    those before them, and nowhere else.
    """
    joints, axes, pivots, order = model.joints, data.joint_jacobian, data.pivots, model.order
    wrenches = model.small
    for i in range(6):
        wrenches[0, i], wrenches[1, i] = scale * pair[i], scale * pair[6 + i]
    while a > 0 or b > 0:
        if a == b:
            for i in range(6):
                wrenches[0, i] += wrenches[1, i]
            b = 0
        side, joint = (0, a) if a > b else (1, b)
        wrench = wrenches[side]
        for row in range(joints[joint, 1] + joints[joint, 2] - 1, joints[joint, 1] - 1, -1):
            left = dot6(axes[row], wrench) * pivots[row, 7]
            column[order[row]] = left
            for i in range(6):
                wrench[i] -= pivots[row, i] * left
        if side == 0:
            a = joints[a, 0]
        else:
            b = joints[b, 0]
