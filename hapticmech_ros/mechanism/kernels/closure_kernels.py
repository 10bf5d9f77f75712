# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Residual φ, Jacobian W and bias Ẇv of each kind of closure, as :mod:`closures` defines them.

A pose is a row of ``poses``, 12 numbers: a frame's three axes in the world, then its origin. A
rod's length is that of the first axis of its frame a. A coupling has a polynomial in the
place of that frame, and no wrenches: see below.

Pairs of wrenches on two joints represent the effect of a closure row, a spring or a push on rates.

A pair is 12 numbers: the wrench on joint a, then that on joint b, forces first, moments about the
world's origin. Only rates of the two joints and of those before them are visited; before a common
joint both wrenches act alike.

Couplings of two joints: one row θ - p(θ_leader), p a polynomial; see :mod:`closures`.

The place of a coupling's frame a is no frame's: it begins with p's five coefficients, the constant
first. Nor is its pose, which begins with p's slope and second derivative at the configuration.
"""

from __future__ import annotations

import math

from hapticmech_ros.compilation import inner, leaf, shaped
from hapticmech_ros.mechanism.kernels.model import Model
from hapticmech_ros.numerics import Array
from hapticmech_ros.numerics.small_matrices import cross, dot, dot6


@leaf
def _of_both(axis: Array, pair: Array) -> float:
    """Return the power of both wrenches; they are added first: common parts cancel exactly."""
    power = axis[0] * (pair[0] + pair[6]) + axis[1] * (pair[1] + pair[7])
    power += axis[2] * (pair[2] + pair[8]) + axis[3] * (pair[3] + pair[9])
    return float(power + (axis[4] * (pair[4] + pair[10]) + axis[5] * (pair[5] + pair[11])))


@inner
def add_pair(
    joints: Array, axes: Array, a: int, b: int, pair: Array, scale: float, force: Array
) -> None:
    """Add ``scale`` times the joint forces of a pair to ``force`` (nv,).

    Args:
        joints: (j, 5) of the model.
        axes: (nv, 6) joint Jacobian.
        a: a joint.
        b: another, or the same.
        pair: (12,) wrenches.
        scale: factor.
        force: to add to.
    """
    while a != b:
        joint, side = (a, 0) if a > b else (b, 6)
        for row in range(joints[joint, 1], joints[joint, 1] + joints[joint, 2]):
            force[row] += scale * dot6(axes[row], pair[side : side + 6])
        if a > b:
            a = joints[a, 0]
        else:
            b = joints[b, 0]
    while a > 0:
        for row in range(joints[a, 1], joints[a, 1] + joints[a, 2]):
            force[row] += scale * _of_both(axes[row], pair)
        a = joints[a, 0]


@inner
def pair_power(joints: Array, axes: Array, a: int, b: int, pair: Array, rates: Array) -> float:
    """Return the power of a pair at rates (nv,); arguments as in :func:`add_pair`."""
    total = 0.0
    while a != b:
        joint, side = (a, 0) if a > b else (b, 6)
        for row in range(joints[joint, 1], joints[joint, 1] + joints[joint, 2]):
            total += rates[row] * dot6(axes[row], pair[side : side + 6])
        if a > b:
            a = joints[a, 0]
        else:
            b = joints[b, 0]
    while a > 0:
        for row in range(joints[a, 1], joints[a, 1] + joints[a, 2]):
            total += rates[row] * _of_both(axes[row], pair)
        a = joints[a, 0]
    return total


@inner
def pull_between(a: Array, b: Array, length: float, pair: Array) -> None:
    """Fill the pair whose power is dᵀ(v_a - v_b) / length, d = p_a - p_b; a, b are poses (12,)."""
    x, y, z = (a[9] - b[9]) / length, (a[10] - b[10]) / length, (a[11] - b[11]) / length
    pair[0], pair[1], pair[2] = x, y, z
    pair[3], pair[4], pair[5] = a[10] * z - a[11] * y, a[11] * x - a[9] * z, a[9] * y - a[10] * x
    pair[6], pair[7], pair[8] = -x, -y, -z
    # The same moment: both act along the line between the two points.
    pair[9], pair[10], pair[11] = -pair[3], -pair[4], -pair[5]


@inner
def gear_error(model: Model, poses: Array, a: int, b: int, q: Array) -> float:
    """Return φ of the joints that carry frames a and b, rad or m; fill p's derivatives."""
    joints, carriers, gear = model.joints, model.carriers, model.placements[a]
    x, value, slope, bend = q[joints[carriers[b], 4]], gear[4], 0.0, 0.0
    for k in range(3, -1, -1):
        bend = bend * x + 2.0 * slope
        slope = slope * x + value
        value = value * x + gear[k]
    poses[a, 0], poses[a, 1] = slope, bend
    return float(q[joints[carriers[a], 4]] - value)


@inner
def gear_speed(model: Model, poses: Array, a: int, b: int, v: Array) -> float:
    """Return φ̇, rad/s or m/s."""
    joints, carriers = model.joints, model.carriers
    return float(v[joints[carriers[a], 1]] - poses[a, 0] * v[joints[carriers[b], 1]])


@inner
def gear_bias(model: Model, poses: Array, a: int, b: int, v: Array) -> float:
    """Return Ẇv, rad/s² or m/s²."""
    speed = v[model.joints[model.carriers[b], 1]]
    return float(-poses[a, 1] * speed * speed)


@inner
def add_gear(model: Model, poses: Array, a: int, b: int, row: Array) -> None:
    """Add the row of W to ``row`` (nv,)."""
    joints, carriers = model.joints, model.carriers
    row[joints[carriers[a], 1]] += 1.0
    row[joints[carriers[b], 1]] -= poses[a, 0]


SPHERICAL, REVOLUTE, WELD, PLANAR_PIN, ROD, COUPLING = range(6)
KINDS = {
    "spherical": SPHERICAL,
    "revolute": REVOLUTE,
    "weld": WELD,
    "planar_pin": PLANAR_PIN,
    "rod": ROD,
    "coupling": COUPLING,
}


@leaf
def end_of_rows(closures: Array, index: int, m: int) -> int:
    """Return the row after the last one of a closure of the model, which have ``m``."""
    return int(m if index + 1 == closures.shape[0] else closures[index + 1, 3])


@inner
def residual_of(
    kind: int, poses: Array, frame_a: int, frame_b: int, first: int, residual: Array
) -> None:
    """Fill φ of two frames into ``residual`` (m,), from row ``first`` on."""
    if kind == ROD:
        length, square = _rod_length(poses, frame_a), 0.0
        for i in range(9, 12):
            square += (poses[frame_a, i] - poses[frame_b, i]) ** 2
        residual[first] = (square - length * length) / (2.0 * length)
        return
    points = 2 if kind == PLANAR_PIN else 3
    for i in range(points):
        residual[first + i] = poses[frame_a, 9 + i] - poses[frame_b, 9 + i]
    if kind in (REVOLUTE, WELD):
        _residual_of_axes(kind, poses[frame_a], poses[frame_b], residual[first + 3 :])


@inner
def _rod_length(poses: Array, frame_a: int) -> float:
    return math.sqrt(dot(poses[frame_a, 0:3], poses[frame_a, 0:3]))


@inner
def _residual_of_axes(kind: int, a: Array, b: Array, out: Array) -> None:
    if kind == REVOLUTE:
        out[0], out[1] = dot(b[0:3], a[6:9]), dot(b[3:6], a[6:9])
        return
    for i in range(3):
        j, k, total = (i + 1) % 3, (i + 2) % 3, 0.0
        for axis in range(0, 9, 3):
            total += b[axis + j] * a[axis + k] - b[axis + k] * a[axis + j]
        out[i] = 0.5 * total


@inner
def wrenches_of(
    kind: int, poses: Array, frame_a: int, frame_b: int, first: int, wrenches: Array
) -> None:
    """Fill W of two frames into ``wrenches`` (m, 12), from row ``first`` on, as pairs.

    A row's pair (see the module) has the row's rate as its power.
    """
    a, b = poses[frame_a], poses[frame_b]
    if kind == ROD:
        pull_between(a, b, _rod_length(poses, frame_a), wrenches[first])
        return
    for i in range(2 if kind == PLANAR_PIN else 3):
        pair = wrenches[first + i]
        pair[:] = 0.0
        pair[i], pair[6 + i] = 1.0, -1.0
        j, k = (i + 1) % 3, (i + 2) % 3
        # p × e
        pair[3 + j], pair[3 + k] = a[9 + k], -a[9 + j]
        pair[9 + j], pair[9 + k] = -b[9 + k], b[9 + j]
    if kind in (REVOLUTE, WELD):
        _wrenches_of_axes(kind, a, b, wrenches[first + 3 :])


@inner
def _wrenches_of_axes(kind: int, a: Array, b: Array, out: Array) -> None:
    for row in range(2 if kind == REVOLUTE else 3):
        for i in range(3):
            out[row, i], out[row, 6 + i] = 0.0, 0.0
        if kind == REVOLUTE:
            cross(a[6:9], b[3 * row : 3 * row + 3], out[row, 3:6])
            for i in range(3):
                out[row, 9 + i] = -out[row, 3 + i]
    if kind == WELD:
        _weld_gains(a, b, out[:, 3:6], out[:, 9:])


@inner
def bias_of(
    kind: int,
    poses: Array,
    frame_a: int,
    frame_b: int,
    motion_a: Array,
    motion_b: Array,
    first: int,
    bias: Array,
    work: Array,
) -> None:
    """Fill Ẇv of frames ``frame_a`` and ``frame_b`` into ``bias`` (m,), from row ``first`` on.

    A motion (12,) is a frame's velocity and angular rate, then its acceleration and angular
    acceleration at v̇ = 0, world axes. ``work`` (2, 12) is used up.
    """
    if kind == ROD:
        total = 0.0
        for i in range(3):
            rate = motion_a[i] - motion_b[i]
            gap = poses[frame_a, 9 + i] - poses[frame_b, 9 + i]
            total += rate * rate + gap * (motion_a[6 + i] - motion_b[6 + i])
        bias[first] = total / _rod_length(poses, frame_a)
        return
    points = 2 if kind == PLANAR_PIN else 3
    for i in range(points):
        bias[first + i] = motion_a[6 + i] - motion_b[6 + i]
    if kind in (REVOLUTE, WELD):
        a, b = poses[frame_a], poses[frame_b]
        _bias_of_axes(kind, a, b, motion_a, motion_b, bias[first:], work)


@inner
def _bias_of_axes(
    kind: int, a: Array, b: Array, motion_a: Array, motion_b: Array, out: Array, work: Array
) -> None:
    rates, turn = shaped(work[0], (4, 3)), shaped(work[1], (4, 3))
    if kind == REVOLUTE:
        z = a[6:9]
        _axis_rates(z, motion_a, rates[0], rates[1], turn[3])
        for k in range(2):
            axis = b[3 * k : 3 * k + 3]
            _axis_rates(axis, motion_b, rates[2], rates[3], turn[3])
            twice = 2.0 * dot(rates[2], rates[0])
            out[3 + k] = dot(rates[3], z) + twice + dot(axis, rates[1])
    else:
        out[3:6] = 0.0
        for k in range(3):
            of_a, of_b = a[3 * k : 3 * k + 3], b[3 * k : 3 * k + 3]
            _axis_rates(of_a, motion_a, rates[0], rates[1], turn[3])
            _axis_rates(of_b, motion_b, rates[2], rates[3], turn[3])
            cross(rates[3], of_a, turn[0])
            cross(rates[2], rates[0], turn[1])
            cross(of_b, rates[1], turn[2])
            for i in range(3):
                out[3 + i] += 0.5 * (turn[0, i] + 2.0 * turn[1, i] + turn[2, i])


@inner
def _axis_rates(axis: Array, motion: Array, first: Array, second: Array, bend: Array) -> None:
    """Fill first and second derivative of a unit axis at zero joint acceleration."""
    cross(motion[3:6], axis, first)
    cross(motion[3:6], first, bend)
    cross(motion[9:], axis, second)
    for i in range(3):
        second[i] += bend[i]


@inner
def _weld_gains(a: Array, b: Array, gain_a: Array, gain_b: Array) -> None:
    for i in range(3):
        for j in range(3):
            relative = 0.0
            for k in range(3):
                relative += a[3 * k + i] * b[3 * k + j]
            gain_a[i, j] = -0.5 * relative
            gain_b[j, i] = 0.5 * relative
    half = -(gain_a[0, 0] + gain_a[1, 1] + gain_a[2, 2])
    for i in range(3):
        gain_a[i, i] += half
        gain_b[i, i] -= half
