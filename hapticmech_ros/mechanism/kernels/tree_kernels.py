# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The tree at a configuration: poses, joint axes, inertias, D and h, as loops inside kernels.

These kernels compute the same as Pinocchio, from its model's constants; tests compare both. Calls
from Python would take longer than the computation itself, and would split a kernel that does a
whole step. Everything is in the world's axes about the world's origin, where inertias and wrenches
of a subtree are sums (Featherstone, Rigid Body Dynamics Algorithms, 6.2 and 5.3).
"""

from __future__ import annotations

import math

import numpy as np
import pinocchio as pin

from hapticmech_ros.compilation import inner, leaf
from hapticmech_ros.mechanism.kernels.model import JOINT_COLUMNS, Data, Model
from hapticmech_ros.numerics import Array
from hapticmech_ros.numerics.small_matrices import cross, dot6

REVOLUTE, PRISMATIC, PLANAR, SPHERICAL, FREE = range(5)
JOINT_KINDS = {
    "revolute": REVOLUTE,
    "prismatic": PRISMATIC,
    "planar": PLANAR,
    "spherical": SPHERICAL,
    "free": FREE,
}
# Columns of ``Model.joint_values``.
_ORIGIN, _AXIS, _MASS, _LEVER, _INERTIA, _TURNS, ARMATURE, CARRIED = 9, 12, 15, 16, 19, 25, 52, 53


def joint_row(
    placement: pin.SE3, axis: Array, inertia: pin.Inertia, armature: float, carried: Array
) -> Array:
    """Return a joint's row (57,) of ``Model.joint_values``.

    Its placement in its parent, axes first, then its axis, its link's mass, centre of mass and
    rotational inertia about it (xx, xy, xz, yy, yz, zz), three matrices column by column (a
    revolute joint's axes in its parent's are A + cos θ B + sin θ C), its rotor's inertia, and its
    link's part that ``gravcomp`` carries.

    Args:
        placement: in its parent, m.
        axis: (3,) unit vector in the joint's frame.
        inertia: of its link in the joint's frame, kg, m and kg m².
        armature: of each of its rates, kg m² or kg.
        carried: (4,) mass on which gravity does not act, kg, and mass times place, kg m.
    """
    row = np.zeros(JOINT_COLUMNS)
    rotation = placement.rotation
    along = np.outer(axis, axis)
    across = np.array(((0, -axis[2], axis[1]), (axis[2], 0, -axis[0]), (-axis[1], axis[0], 0)))
    row[:_AXIS] = np.concatenate((rotation.T.ravel(), placement.translation))
    row[_AXIS:_MASS], row[_MASS], row[_LEVER:_INERTIA] = axis, inertia.mass, inertia.lever
    row[_INERTIA:_TURNS] = inertia.inertia[np.triu_indices(3)]
    turns = (along, np.eye(3) - along, across)
    row[_TURNS:ARMATURE] = np.concatenate([(rotation @ turn).T.ravel() for turn in turns])
    row[ARMATURE], row[CARRIED:] = armature, carried
    return row


@inner
def place_tree(model: Model, q: Array, data: Data) -> None:
    """Fill joint axes, poses of joints and frames, and inertias at q (nq,)."""
    local, moved, turn = model.small[0], model.small[1], model.small[2]
    joints, all_values = model.joints, model.joint_values
    places, bodies, axes = data.places, data.bodies, data.joint_jacobian
    for i in range(12):
        places[0, i] = 1.0 if i == 0 or i == 4 or i == 8 else 0.0
        bodies[0, i] = 0.0
    for joint in range(1, joints.shape[0]):
        parent, kind = joints[joint, 0], joints[joint, 3]
        first, at = joints[joint, 1], joints[joint, 4]
        values = all_values[joint]
        _move_joint(kind, values, q[at:], turn, local, moved)
        place, base = places[joint], places[parent]
        for i in range(3):
            total = base[9 + i]
            for k in range(3):
                total += base[3 * k + i] * moved[k]
                turned = base[i] * local[3 * k]
                turned += base[3 + i] * local[3 * k + 1]
                turned += base[6 + i] * local[3 * k + 2]
                place[3 * k + i] = turned
            place[9 + i] = total
        _axes_of(kind, values, place, axes, first)
        _body_of(values, place, bodies[joint])
    _place_frames(model, places, data.poses)


@leaf
def _move_joint(
    kind: int, values: Array, q: Array, turn: Array, local: Array, moved: Array
) -> None:
    """Fill the axes (9,) and origin (3,) of a joint in its parent's joint; ``turn`` is used up."""
    for i in range(3):
        moved[i] = values[_ORIGIN + i]
    if kind == REVOLUTE:
        cosine, sine = math.cos(q[0]), math.sin(q[0])
        for i in range(9):
            local[i] = values[_TURNS + i] + cosine * values[_TURNS + 9 + i]
            local[i] += sine * values[_TURNS + 18 + i]
        return
    if kind == PRISMATIC:
        for i in range(9):
            local[i] = values[i]
        for i in range(3):
            for k in range(3):
                moved[i] += values[3 * k + i] * (values[_AXIS + k] * q[0])
        return
    if kind == PLANAR:
        turn[:9] = 0.0
        turn[0], turn[1], turn[3], turn[4], turn[8] = q[2], q[3], -q[3], q[2], 1.0
        for i in range(3):
            moved[i] += values[i] * q[0] + values[3 + i] * q[1]
    else:
        unit = q
        if kind == FREE:
            unit = q[3:]
            for i in range(3):
                moved[i] += values[i] * q[0] + values[3 + i] * q[1] + values[6 + i] * q[2]
        _turn_of(unit[0], unit[1], unit[2], unit[3], turn)
    for k in range(3):
        for i in range(3):
            total = values[i] * turn[3 * k] + values[3 + i] * turn[3 * k + 1]
            local[3 * k + i] = total + values[6 + i] * turn[3 * k + 2]


@leaf
def _turn_of(x: float, y: float, z: float, w: float, turn: Array) -> None:
    """Fill the axes (9,) that a unit quaternion turns to."""
    tx, ty, tz = 2.0 * x, 2.0 * y, 2.0 * z
    turn[0], turn[1], turn[2] = 1.0 - (ty * y + tz * z), ty * x + tz * w, tz * x - ty * w
    turn[3], turn[4], turn[5] = ty * x - tz * w, 1.0 - (tx * x + tz * z), tz * y + tx * w
    turn[6], turn[7], turn[8] = tz * x + ty * w, tz * y - tx * w, 1.0 - (tx * x + ty * y)


@leaf
def _axes_of(kind: int, values: Array, place: Array, jacobian: Array, first: int) -> None:
    """Fill a joint's rows of the joint Jacobian (nv, 6), from ``first`` on."""
    if kind in (REVOLUTE, PRISMATIC):
        axis = jacobian[first, 3:6] if kind == REVOLUTE else jacobian[first, 0:3]
        for i in range(3):
            total = place[i] * values[_AXIS] + place[3 + i] * values[_AXIS + 1]
            axis[i] = total + place[6 + i] * values[_AXIS + 2]
        if kind == REVOLUTE:
            cross(place[9:12], axis, jacobian[first, 0:3])
        else:
            jacobian[first, 3], jacobian[first, 4], jacobian[first, 5] = 0.0, 0.0, 0.0
        return
    slides = 3 if kind == FREE else (2 if kind == PLANAR else 0)
    for k in range(slides):
        for i in range(3):
            jacobian[first + k, i], jacobian[first + k, 3 + i] = place[3 * k + i], 0.0
    for k in range(2 if kind == PLANAR else 0, 3):
        row = first + slides + (0 if kind == PLANAR else k)
        for i in range(3):
            jacobian[row, 3 + i] = place[3 * k + i]
        cross(place[9:12], place[3 * k : 3 * k + 3], jacobian[row, 0:3])


@leaf
def _body_of(values: Array, place: Array, body: Array) -> None:
    """Fill a link's inertia (12,) about the world's origin."""
    mass = values[_MASS]
    ixx, ixy, ixz = values[_INERTIA], values[_INERTIA + 1], values[_INERTIA + 2]
    iyy, iyz, izz = values[_INERTIA + 3], values[_INERTIA + 4], values[_INERTIA + 5]
    x = place[9] + _along(place, 0, values)
    y = place[10] + _along(place, 1, values)
    z = place[11] + _along(place, 2, values)
    body[0], body[1], body[2], body[3] = mass, mass * x, mass * y, mass * z
    at = 4
    for i in range(3):
        a = place[i] * ixx + place[3 + i] * ixy + place[6 + i] * ixz
        b = place[i] * ixy + place[3 + i] * iyy + place[6 + i] * iyz
        c = place[i] * ixz + place[3 + i] * iyz + place[6 + i] * izz
        for j in range(i, 3):
            body[at] = a * place[j] + b * place[3 + j] + c * place[6 + j]
            at += 1
    body[4] += mass * (y * y + z * z)
    body[5] -= mass * x * y
    body[6] -= mass * x * z
    body[7] += mass * (x * x + z * z)
    body[8] -= mass * y * z
    body[9] += mass * (x * x + y * y)


@leaf
def _along(place: Array, i: int, values: Array) -> float:
    total = place[i] * values[_LEVER] + place[3 + i] * values[_LEVER + 1]
    return float(total + place[6 + i] * values[_LEVER + 2])


@inner
def _place_frames(model: Model, places: Array, poses: Array) -> None:
    """Fill the frames' poses in the world from those of their joints."""
    carriers, placements = model.carriers, model.placements
    for frame in range(carriers.size):
        joint = carriers[frame]
        for column in range(0, 12, 3):
            x, y = placements[frame, column], placements[frame, column + 1]
            z = placements[frame, column + 2]
            for i in range(3):
                turned = places[joint, i] * x
                turned += places[joint, 3 + i] * y
                turned += places[joint, 6 + i] * z
                poses[frame, column + i] = turned
        for i in range(3):
            poses[frame, 9 + i] += places[joint, 9 + i]


@leaf
def momentum(body: Array, twist: Array, out: Array) -> None:
    """Fill ``out`` (6,) with a body's momentum at a twist (6,), about the world's origin."""
    m, hx, hy, hz = body[0], body[1], body[2], body[3]
    x, y, z, a, b, c = twist[0], twist[1], twist[2], twist[3], twist[4], twist[5]
    out[0] = m * x + (b * hz - c * hy)
    out[1] = m * y + (c * hx - a * hz)
    out[2] = m * z + (a * hy - b * hx)
    out[3] = (hy * z - hz * y) + (body[4] * a + body[5] * b + body[6] * c)
    out[4] = (hz * x - hx * z) + (body[5] * a + body[7] * b + body[8] * c)
    out[5] = (hx * y - hy * x) + (body[6] * a + body[8] * b + body[9] * c)


@inner
def inertia_of(model: Model, data: Data, inertia: Array) -> None:
    """Fill the lower triangle of D (nv, nv)."""
    joints, axes = model.joints, data.joint_jacobian
    subtree, moved, bodies = model.sweep, model.small[0], data.bodies
    for joint in range(joints.shape[0]):
        for k in range(10):
            subtree[joint, k] = bodies[joint, k]
    for row in range(model.nv):
        for col in range(row):
            inertia[row, col] = 0.0
    for joint in range(joints.shape[0] - 1, 0, -1):
        parent, first = joints[joint, 0], joints[joint, 1]
        for k in range(10):
            subtree[parent, k] += subtree[joint, k]
        for row in range(first, first + joints[joint, 2]):
            momentum(subtree[joint], axes[row], moved)
            for col in range(first, row + 1):
                inertia[row, col] = dot6(axes[col], moved)
            inertia[row, row] += model.joint_values[joint, ARMATURE]
            above = parent
            while above > 0:
                start = joints[above, 1]
                for col in range(start, start + joints[above, 2]):
                    inertia[row, col] = dot6(axes[col], moved)
                above = joints[above, 0]


@leaf
def carried_place(values: Array, place: Array, at: Array) -> float:
    """Fill ``at`` (3,) with mass times place of a link's carried part; return its mass, kg."""
    mass = values[CARRIED]
    for i in range(3):
        total = mass * place[9 + i] + place[i] * values[CARRIED + 1]
        total += place[3 + i] * values[CARRIED + 2] + place[6 + i] * values[CARRIED + 3]
        at[i] = total
    return float(mass)


@inner
def bias_force_of(model: Model, data: Data, motions: Array, force: Array) -> None:
    """Fill ``force`` (nv,) with h, given the joints' motions (see ``motion_kernels``)."""
    joints, axes, gravity = model.joints, data.joint_jacobian, model.gravity
    wrenches, lifted, carried = model.sweep, model.small[0], model.small[1]
    bodies = data.bodies
    for joint in range(1, joints.shape[0]):
        for k in range(6):
            lifted[k] = motions[joint, 6 + k]
        for k in range(3):
            lifted[k] -= gravity[k]
        twist, wrench = motions[joint], wrenches[joint]
        momentum(bodies[joint], lifted, wrench)
        momentum(bodies[joint], twist, carried)
        x, y, z, a, b, c = twist[0], twist[1], twist[2], twist[3], twist[4], twist[5]
        px, py, pz = carried[0], carried[1], carried[2]
        wrench[0] += b * pz - c * py
        wrench[1] += c * px - a * pz
        wrench[2] += a * py - b * px
        wrench[3] += (b * carried[5] - c * carried[4]) + (y * pz - z * py)
        wrench[4] += (c * carried[3] - a * carried[5]) + (z * px - x * pz)
        wrench[5] += (a * carried[4] - b * carried[3]) + (x * py - y * px)
        if model.joint_values[joint, CARRIED] != 0.0:
            mass = carried_place(model.joint_values[joint], data.places[joint], carried)
            for k in range(3):
                wrench[k] += mass * gravity[k]
            cross(carried, gravity, lifted)
            for k in range(3):
                wrench[3 + k] += lifted[k]
    for joint in range(joints.shape[0] - 1, 0, -1):
        parent, first = joints[joint, 0], joints[joint, 1]
        for row in range(first, first + joints[joint, 2]):
            force[row] = dot6(axes[row], wrenches[joint])
        if parent > 0:
            for k in range(6):
                wrenches[parent, k] += wrenches[joint, k]
