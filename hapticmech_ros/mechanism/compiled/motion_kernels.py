"""What moves: operational points and the closures' Ẇv.

Everything follows from joint Jacobians in the world's axes at the world's origin: the twist of a
body is its parent's and its joint's, and so is the derivative of it.
"""

from __future__ import annotations

import numpy as np

from hapticmech_ros.compilation import inner, kernel
from hapticmech_ros.mechanism.compiled.closure_kernels import bias_of
from hapticmech_ros.mechanism.compiled.element_kernels import element_forces
from hapticmech_ros.mechanism.compiled.packed import Packed, unpack
from hapticmech_ros.mechanism.compiled.tables import Tables, unfold
from hapticmech_ros.mechanism.model import Array


@inner
def move_joints(tables: Tables, space: Packed, v: Array, motions: Array) -> None:
    """Fill ``motions`` (joints, 12) with every joint's motion at the world's origin, at v̇ = 0.

    A motion is a velocity and an angular rate, then their derivatives. Joint axes are fixed in the
    body that the joint moves, so that their rate is twist × axis.
    """
    motions[0] = 0.0
    for joint in range(1, tables.joints.shape[0]):
        parent, first = tables.joints[joint, 0], tables.joints[joint, 1]
        x, y, z, a, b, c = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
        for rate in range(first, first + tables.joints[joint, 2]):
            x += space.joint_jacobian[rate, 0] * v[rate]
            y += space.joint_jacobian[rate, 1] * v[rate]
            z += space.joint_jacobian[rate, 2] * v[rate]
            a += space.joint_jacobian[rate, 3] * v[rate]
            b += space.joint_jacobian[rate, 4] * v[rate]
            c += space.joint_jacobian[rate, 5] * v[rate]
        px, py, pz = motions[parent, 0] + x, motions[parent, 1] + y, motions[parent, 2] + z
        wx, wy, wz = motions[parent, 3] + a, motions[parent, 4] + b, motions[parent, 5] + c
        motions[joint, 0], motions[joint, 1], motions[joint, 2] = px, py, pz
        motions[joint, 3], motions[joint, 4], motions[joint, 5] = wx, wy, wz
        motions[joint, 6] = motions[parent, 6] + (wy * z - wz * y) + (py * c - pz * b)
        motions[joint, 7] = motions[parent, 7] + (wz * x - wx * z) + (pz * a - px * c)
        motions[joint, 8] = motions[parent, 8] + (wx * y - wy * x) + (px * b - py * a)
        motions[joint, 9] = motions[parent, 9] + (wy * c - wz * b)
        motions[joint, 10] = motions[parent, 10] + (wz * a - wx * c)
        motions[joint, 11] = motions[parent, 11] + (wx * b - wy * a)


@inner
def _move_frame(tables: Tables, space: Packed, motions: Array, frame: int, motion: Array) -> None:
    """Fill the motion (12,) of a frame's origin from that of its joint at the world's origin."""
    joint = tables.carriers[frame]
    x, y, z = space.poses[frame, 9], space.poses[frame, 10], space.poses[frame, 11]
    a, b, c = motions[joint, 3], motions[joint, 4], motions[joint, 5]
    d, e, f = motions[joint, 9], motions[joint, 10], motions[joint, 11]
    vx = motions[joint, 0] + (b * z - c * y)
    vy = motions[joint, 1] + (c * x - a * z)
    vz = motions[joint, 2] + (a * y - b * x)
    motion[0], motion[1], motion[2], motion[3], motion[4], motion[5] = vx, vy, vz, a, b, c
    motion[6] = motions[joint, 6] + (e * z - f * y) + (b * vz - c * vy)
    motion[7] = motions[joint, 7] + (f * x - d * z) + (c * vx - a * vz)
    motion[8] = motions[joint, 8] + (d * y - e * x) + (a * vy - b * vx)
    motion[9], motion[10], motion[11] = d, e, f


@inner
def closure_bias(tables: Tables, space: Packed, motions: Array, bias: Array) -> None:
    """Fill ``bias`` (m,) with Ẇv, given the joints' motions."""
    motion_a, motion_b = np.empty(12), np.empty(12)
    for index in range(tables.closures.shape[0]):
        kind, a = tables.closures[index, 0], tables.closures[index, 1]
        b, first = tables.closures[index, 2], tables.closures[index, 3]
        _move_frame(tables, space, motions, a, motion_a)
        _move_frame(tables, space, motions, b, motion_b)
        bias_of(kind, space.poses, a, b, motion_a, motion_b, first, bias)


@inner
def move_point(
    tables: Tables, space: Packed, motions: Array, index: int, jacobian: Array, motion: Array
) -> None:
    """Fill an operational point's J_h (6, nv), and its J_h v and J̇_h v (12,)."""
    frame = tables.points[index]
    x, y, z = space.poses[frame, 9], space.poses[frame, 10], space.poses[frame, 11]
    axes = space.joint_jacobian
    for col in range(tables.nv):
        on = tables.support[frame, col]
        a, b, c = axes[col, 3], axes[col, 4], axes[col, 5]
        jacobian[0, col] = on * (axes[col, 0] + (b * z - c * y))
        jacobian[1, col] = on * (axes[col, 1] + (c * x - a * z))
        jacobian[2, col] = on * (axes[col, 2] + (a * y - b * x))
        jacobian[3, col], jacobian[4, col], jacobian[5, col] = on * a, on * b, on * c
    _move_frame(tables, space, motions, frame, motion)


@inner
def add_point_forces(tables: Tables, space: Packed, wrenches: Array, force: Array) -> None:
    """Add Σ J_hᵀ F to ``force`` (nv,), wrenches (points, 6) given, without any J_h."""
    axes = space.joint_jacobian
    for index in range(tables.points.size):
        frame = tables.points[index]
        x, y, z = space.poses[frame, 9], space.poses[frame, 10], space.poses[frame, 11]
        fx, fy, fz = wrenches[index, 0], wrenches[index, 1], wrenches[index, 2]
        tx = wrenches[index, 3] + (y * fz - z * fy)
        ty = wrenches[index, 4] + (z * fx - x * fz)
        tz = wrenches[index, 5] + (x * fy - y * fx)
        for col in range(tables.nv):
            power = axes[col, 0] * fx + axes[col, 1] * fy + axes[col, 2] * fz
            power += axes[col, 3] * tx + axes[col, 4] * ty + axes[col, 5] * tz
            force[col] += tables.support[frame, col] * power


@kernel(
    "void(int64[::1], float64[::1], float64[::1], float64[::1], float64[::1], float64[::1],"
    " float64[::1], float64[:,::1])"
)
def move_frames(
    numbers: Array,
    values: Array,
    packed: Array,
    bias_force: Array,
    q: Array,
    v: Array,
    terms: Array,
    poses: Array,
) -> None:
    """Fill the terms of Eq. 1 that depend on rates, and what operational points need.

    Args:
        numbers: constants of the mechanism, whole ones.
        values: the others; see ``tables.unfold``.
        packed: the configuration's terms.
        bias_force: (nv,) h.
        q: (nq,) configuration.
        v: (nv,) rates.
        terms: (3 nv + m + points (6 nv + 12),) to fill with h, forces of elements, their
            dissipative part, Ẇv; then for each operational point J_h, J_h v and J̇_h v.
        poses: (points, 12) to fill.
    """
    tables = unfold(numbers, values)
    nv, m = tables.nv, tables.m
    space = unpack(packed, nv, m)
    for c in range(nv):
        terms[c] = bias_force[c]
    element_forces(tables, space, q, v, terms[nv : 2 * nv], terms[2 * nv : 3 * nv])
    motions = np.empty((tables.joints.shape[0], 12))
    move_joints(tables, space, v, motions)
    closure_bias(tables, space, motions, terms[3 * nv : 3 * nv + m])
    at = 3 * nv + m
    for index in range(tables.points.size):
        jacobian = terms[at : at + 6 * nv].reshape(6, nv)
        at += 6 * nv
        move_point(tables, space, motions, index, jacobian, terms[at : at + 12])
        at += 12
        poses[index] = space.poses[tables.points[index]]
