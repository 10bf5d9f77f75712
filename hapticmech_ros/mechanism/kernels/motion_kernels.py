# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Motions of joints and operational points, and the closures' Ẇv.

Everything follows from joint Jacobians in the world's axes at the world's origin: the twist of a
body is its parent's and its joint's, and so is the derivative of it.
"""

from __future__ import annotations

from hapticmech_ros.compilation import inner, kernel, leaf, put, shaped
from hapticmech_ros.mechanism.kernels.closure_kernels import COUPLING, add_pair, bias_of, gear_bias
from hapticmech_ros.mechanism.kernels.element_kernels import element_forces
from hapticmech_ros.mechanism.kernels.model import Data, Model
from hapticmech_ros.mechanism.kernels.tree_kernels import bias_force_of
from hapticmech_ros.numerics import Array
from hapticmech_ros.numerics.small_matrices import is_zero


@inner
def move_joints(model: Model, data: Data, v: Array, motions: Array) -> None:
    """Fill ``motions`` (joints, 12) with every joint's motion at the world's origin, at v̇ = 0.

    A motion is a velocity and an angular rate, then their derivatives. Joint axes are fixed in the
    body that the joint moves: their rate is twist × axis.
    """
    joints, axes = model.joints, data.joint_jacobian
    motions[0][:] = 0.0
    for joint in range(1, joints.shape[0]):
        parent, first = joints[joint, 0], joints[joint, 1]
        x, y, z, a, b, c = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
        for rate in range(first, first + joints[joint, 2]):
            x += axes[rate, 0] * v[rate]
            y += axes[rate, 1] * v[rate]
            z += axes[rate, 2] * v[rate]
            a += axes[rate, 3] * v[rate]
            b += axes[rate, 4] * v[rate]
            c += axes[rate, 5] * v[rate]
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


@leaf
def _move_frame(model: Model, data: Data, motions: Array, frame: int, motion: Array) -> None:
    """Fill the motion (12,) of a frame's origin from that of its joint at the world's origin."""
    joint = model.carriers[frame]
    pose = data.poses[frame]
    x, y, z = pose[9], pose[10], pose[11]
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
def closure_bias(model: Model, data: Data, v: Array, motions: Array, bias: Array) -> None:
    """Fill ``bias`` (m,) with Ẇv, given rates (nv,) and the joints' motions at them."""
    small, closures, poses = model.small, model.closures, data.poses
    motion_a, motion_b = small[0], small[1]
    for index in range(closures.shape[0]):
        row_of = closures[index]
        kind, a, b, first = row_of[0], row_of[1], row_of[2], row_of[3]
        if kind == COUPLING:
            bias[first] = gear_bias(model, poses, a, b, v)
            continue
        _move_frame(model, data, motions, a, motion_a)
        _move_frame(model, data, motions, b, motion_b)
        bias_of(kind, poses, a, b, motion_a, motion_b, first, bias, small[2:])


@inner
def move_point(
    model: Model, data: Data, motions: Array, index: int, jacobian: Array, motion: Array
) -> None:
    """Fill an operational point's J_h (6, nv), and its J_h v and J̇_h v (12,)."""
    frame = model.points[index]
    x, y, z = data.poses[frame, 9], data.poses[frame, 10], data.poses[frame, 11]
    axes, joint, joints = data.joint_jacobian, model.carriers[frame], model.joints
    jacobian[:] = 0.0
    while joint > 0:
        first = joints[joint, 1]
        for col in range(first, first + joints[joint, 2]):
            a, b, c = axes[col, 3], axes[col, 4], axes[col, 5]
            jacobian[0, col] = axes[col, 0] + (b * z - c * y)
            jacobian[1, col] = axes[col, 1] + (c * x - a * z)
            jacobian[2, col] = axes[col, 2] + (a * y - b * x)
            jacobian[3, col], jacobian[4, col], jacobian[5, col] = a, b, c
        joint = joints[joint, 0]
    _move_frame(model, data, motions, frame, motion)


@inner
def add_wrench(
    model: Model, data: Data, joint: int, origin: Array, wrench: Array, force: Array
) -> None:
    """Add Jᵀ F to ``force`` (nv,) for a wrench (6,) on a joint at a point (3,), world axes."""
    pair = model.small[0]
    pair[6:] = 0.0
    x, y, z = origin[0], origin[1], origin[2]
    fx, fy, fz = wrench[0], wrench[1], wrench[2]
    pair[0], pair[1], pair[2] = fx, fy, fz
    pair[3] = wrench[3] + (y * fz - z * fy)
    pair[4] = wrench[4] + (z * fx - x * fz)
    pair[5] = wrench[5] + (x * fy - y * fx)
    add_pair(model.joints, data.joint_jacobian, joint, 0, pair, 1.0, force)


@inner
def add_point_forces(model: Model, data: Data, wrenches: Array, force: Array) -> None:
    """Add Σ J_hᵀ F to ``force`` (nv,), wrenches (points, 6) given, without any J_h."""
    for index in range(model.points.size):
        wrench = wrenches[index]
        if not is_zero(wrench):
            frame = model.points[index]
            origin, joint = data.poses[frame, 9:12], model.carriers[frame]
            add_wrench(model, data, joint, origin, wrench, force)


@inner
def add_link_forces(model: Model, data: Data, external: Array, force: Array) -> None:
    """Add Σ Jᵀ F of wrenches on links to ``force`` (nv,).

    Args:
        model: the mechanism's.
        data: filled at a configuration.
        external: (pushes, 10) per wrench the joint that carries the link, the origin of the link in
            that joint (3,), and the wrench (6,) there, world axes.
        force: to add to.
    """
    origin = model.small[1]
    for index in range(external.shape[0]):
        push = external[index]
        joint = int(push[0])
        place = data.places[joint]
        for i in range(3):
            total = place[i] * push[1] + place[3 + i] * push[2] + place[6 + i] * push[3]
            origin[i] = place[9 + i] + total
        add_wrench(model, data, joint, origin, push[4:10], force)


@kernel("void(Model, Data, float64[::1], float64[::1], float64[::1], float64[:,::1])")
def move_frames(model: Model, data: Data, q: Array, v: Array, terms: Array, poses: Array) -> None:
    """Fill the terms of Eq. 1 that depend on rates, and those of operational points.

    Args:
        model: constants of the mechanism.
        data: the configuration's terms.
        q: (nq,) configuration.
        v: (nv,) rates, rad/s or m/s.
        terms: (3 nv + m + points (6 nv + 12),) to fill with h, forces of elements, their
            dissipative part, Ẇv; then for each operational point J_h, J_h v and J̇_h v.
        poses: (points, 12) to fill: each point's axes in the world, then its origin, m.
    """
    nv, m = model.nv, model.m
    element_forces(model, data, q, v, terms[nv : 2 * nv], terms[2 * nv : 3 * nv])
    motions = model.motions
    move_joints(model, data, v, motions)
    bias_force_of(model, data, motions, terms[:nv])
    closure_bias(model, data, v, motions, terms[3 * nv : 3 * nv + m])
    at = 3 * nv + m
    for index in range(model.points.size):
        jacobian = shaped(terms[at : at + 6 * nv], (6, nv))
        at += 6 * nv
        move_point(model, data, motions, index, jacobian, terms[at : at + 12])
        at += 12
        put(poses[index], data.poses[model.points[index]])
