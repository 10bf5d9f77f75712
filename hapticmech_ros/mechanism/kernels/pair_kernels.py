# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Pairs of wrenches on two joints: what a closure row, a spring or a push does to the rates.

A pair is 12 numbers: the wrench on joint a, then that on joint b, forces first, moments about the
world's origin. Only rates of the two joints and of those before them are visited; where these are
the same for both, so is what their wrenches share.

Couplings of two joints: one row θ - p(θ_leader), p a polynomial; see :mod:`closures`.

The place of a coupling's frame a is no frame's: it begins with p's five coefficients, the constant
first. Nor is its pose, which begins with p's slope and second derivative at the configuration.
"""

from __future__ import annotations

from hapticmech_ros.arrays import Array
from hapticmech_ros.compilation import inner, leaf
from hapticmech_ros.mechanism.kernels.model import Model
from hapticmech_ros.mechanism.kernels.small_matrices import dot6


@leaf
def _of_both(axis: Array, pair: Array) -> float:
    """Return the power of both wrenches; added first, so that what they share cancels exactly."""
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
