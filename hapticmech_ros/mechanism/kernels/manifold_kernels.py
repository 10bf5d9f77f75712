# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""q ⊕ θ, its inverse, and the rate of θ, joint by joint, as Pinocchio has them.

Positions of revolute and prismatic joints are numbers. The others are poses: of a planar joint x,
y, cosine and sine, of a spherical one a quaternion x, y, z, w, of a free one both a position and a
quaternion; θ is a twist in the joint's own axes, and ⊕ multiplies by its exponential.
"""

from __future__ import annotations

import math

from hapticmech_ros.compilation import inner, shaped
from hapticmech_ros.mechanism.kernels.model import Model
from hapticmech_ros.mechanism.kernels.tree_kernels import (
    FREE,
    PLANAR,
    PRISMATIC,
    REVOLUTE,
    SPHERICAL,
)
from hapticmech_ros.numerics import Array
from hapticmech_ros.numerics.rotation_kernels import angular_rate, log_quaternion, rotation_of

# Below this angle, rad, six terms of Bernoulli's series are exact to rounding, above it the closed
# form is.
SERIES = 0.3
# B_2n / (2n)!
_BERNOULLI = (
    1.0 / 12.0,
    -1.0 / 720.0,
    1.0 / 30240.0,
    -1.0 / 1209600.0,
    1.0 / 47900160.0,
    -691.0 / 1307674368000.0,
)


@inner
def move(model: Model, start: Array, theta: Array, q: Array) -> None:
    """Fill ``q`` (nq,) with start ⊕ theta; it may be ``start`` itself."""
    joints, small = model.joints, model.small
    turn, moved, along = small[0, :3], small[0, 3:6], small[0, 6:9]
    rotation = shaped(small[1, :9], (3, 3))
    for joint in range(1, joints.shape[0]):
        first, kind, at = joints[joint, 1], joints[joint, 3], joints[joint, 4]
        if kind in (REVOLUTE, PRISMATIC):
            q[at] = start[at] + theta[first]
        elif kind == PLANAR:
            _move_planar(start[at : at + 4], theta[first : first + 3], q[at : at + 4])
        elif kind == SPHERICAL:
            _turn_quaternion(start[at : at + 4], theta[first : first + 3], q[at : at + 4])
        else:
            for i in range(3):
                moved[i], turn[i] = theta[first + i], theta[first + 3 + i]
            rotation_of(start[at + 3 : at + 7], rotation)
            # The left Jacobian of the rotation turns a constant twist into a displacement.
            angular_rate(turn, moved, along)
            for i in range(3):
                total = start[at + i]
                for k in range(3):
                    total += rotation[i, k] * along[k]
                q[at + i] = total
            _turn_quaternion(start[at + 3 : at + 7], turn, q[at + 3 : at + 7])


@inner
def configure(model: Model, theta: Array, q: Array) -> None:
    """Fill ``q`` (nq,) with the neutral configuration ⊕ theta (nv,)."""
    joints = model.joints
    q[:] = 0.0
    for joint in range(1, joints.shape[0]):
        kind, at = joints[joint, 3], joints[joint, 4]
        if kind == PLANAR:
            q[at + 2] = 1.0
        elif kind == SPHERICAL:
            q[at + 3] = 1.0
        elif kind == FREE:
            q[at + 6] = 1.0
    move(model, q, theta, q)


@inner
def coordinates_of(model: Model, q: Array, theta: Array) -> None:
    """Fill ``theta`` (nv,) with what :func:`configure` makes ``q`` (nq,) of; angles up to π."""
    joints = model.joints
    for joint in range(1, joints.shape[0]):
        first, kind, at = joints[joint, 1], joints[joint, 3], joints[joint, 4]
        if kind in (REVOLUTE, PRISMATIC):
            theta[first] = q[at]
        elif kind == PLANAR:
            half = 0.5 * math.atan2(q[at + 3], q[at + 2])
            kept, x, y = _half_cotangent(half), q[at], q[at + 1]
            theta[first], theta[first + 1] = kept * x + half * y, kept * y - half * x
            theta[first + 2] = 2.0 * half
        elif kind == SPHERICAL:
            x, y, z, w = q[at], q[at + 1], q[at + 2], q[at + 3]
            log_quaternion(x, y, z, w, theta[first : first + 3])
        else:
            turn = theta[first + 3 : first + 6]
            log_quaternion(q[at + 3], q[at + 4], q[at + 5], q[at + 6], turn)
            a, b, c = turn[0], turn[1], turn[2]
            x, y, z = q[at], q[at + 1], q[at + 2]
            u, v, w = b * z - c * y, c * x - a * z, a * y - b * x
            # J⁻¹ of the rotation's left Jacobian: 1 - [ω]/2 + (1 - θ/2 cot θ/2) / θ² [ω]².
            square = a * a + b * b + c * c
            twice = 0.0
            if square > 0.0:
                twice = (1.0 - _half_cotangent(0.5 * math.sqrt(square))) / square
            theta[first] = x - 0.5 * u + twice * (b * w - c * v)
            theta[first + 1] = y - 0.5 * v + twice * (c * u - a * w)
            theta[first + 2] = z - 0.5 * w + twice * (a * v - b * u)


@inner
def _half_cotangent(half: float) -> float:
    """Return x cot x."""
    return half / math.tan(half) if half != 0.0 else 1.0


@inner
def _move_planar(start: Array, theta: Array, q: Array) -> None:
    cosine, sine, angle = start[2], start[3], theta[2]
    turned, along = math.cos(angle), math.sin(angle)
    if abs(angle) > 1e-4:
        kept, lost = along / angle, (1.0 - turned) / angle
    else:
        kept, lost = 1.0 - angle * angle / 6.0, angle / 2.0 * (1.0 - angle * angle / 12.0)
    x = kept * theta[0] - lost * theta[1]
    y = lost * theta[0] + kept * theta[1]
    q[0], q[1] = start[0] + cosine * x - sine * y, start[1] + sine * x + cosine * y
    a, b = cosine * turned - sine * along, sine * turned + cosine * along
    length = math.sqrt(a * a + b * b)
    q[2], q[3] = a / length, b / length


@inner
def _turn_quaternion(start: Array, turn: Array, q: Array) -> None:
    """Fill ``q`` (4,) with start times the rotation by ``turn`` (3,), of length 1."""
    x, y, z, w = start[0], start[1], start[2], start[3]
    square = turn[0] * turn[0] + turn[1] * turn[1] + turn[2] * turn[2]
    angle = math.sqrt(square)
    half = math.sin(0.5 * angle) / angle if angle > 1e-4 else 0.5 - square / 48.0
    a, b, c, d = half * turn[0], half * turn[1], half * turn[2], math.cos(0.5 * angle)
    i = w * a + x * d + y * c - z * b
    j = w * b + y * d + z * a - x * c
    k = w * c + z * d + x * b - y * a
    r = w * d - x * a - y * b - z * c
    length = math.sqrt(i * i + j * j + k * k + r * r)
    q[0], q[1], q[2], q[3] = i / length, j / length, k / length, r / length


@inner
def local_rates(model: Model, theta: Array, v: Array, rates: Array) -> None:
    """Fill ``rates`` (nv,) with θ̇ = J_r(θ)⁻¹ v."""
    joints, small = model.joints, model.small
    twist, speed = small[0, :6], small[0, 6:]
    for joint in range(1, joints.shape[0]):
        first, kind = joints[joint, 1], joints[joint, 3]
        if kind in (REVOLUTE, PRISMATIC):
            rates[first] = v[first]
            continue
        # Where a joint's rates are in a twist: all six, the last three, or two and the last.
        count = joints[joint, 2]
        twist[:] = 0.0
        speed[:] = 0.0
        for k in range(count):
            at = _place_in_twist(kind, k)
            twist[at], speed[at] = theta[first + k], v[first + k]
        _inverse_right(twist, speed, small[1, :6], small[1, 6:])
        for k in range(count):
            rates[first + k] = speed[_place_in_twist(kind, k)]


@inner
def _place_in_twist(kind: int, k: int) -> int:
    if kind == FREE:
        return k
    if kind == SPHERICAL:
        return 3 + k
    return 5 if k == 2 else k


@inner
def _bracket(twist: Array, speed: Array) -> None:
    """Replace ``speed`` (6,) by [twist, speed]."""
    x, y, z, a, b, c = twist[0], twist[1], twist[2], twist[3], twist[4], twist[5]
    u, v, w, d, e, f = speed[0], speed[1], speed[2], speed[3], speed[4], speed[5]
    speed[0] = (b * w - c * v) + (y * f - z * e)
    speed[1] = (c * u - a * w) + (z * d - x * f)
    speed[2] = (a * v - b * u) + (x * e - y * d)
    speed[3], speed[4], speed[5] = b * f - c * e, c * d - a * f, a * e - b * d


@inner
def _inverse_right(twist: Array, speed: Array, power: Array, total: Array) -> None:
    """Replace ``speed`` (6,) by J_r(twist)⁻¹ speed, J_r of the exponential of twists.

    1 + ad/2 + A ad² + B ad⁴ (Bullo and Murray, Proportional derivative control on the Euclidean
    group, 1995), or the series that this sums. ``power`` and ``total`` (6,) are used up.
    """
    angle = math.sqrt(twist[3] * twist[3] + twist[4] * twist[4] + twist[5] * twist[5])
    for i in range(6):
        power[i] = total[i] = speed[i]
    _bracket(twist, power)
    for i in range(6):
        total[i] += 0.5 * power[i]
    if angle < SERIES:
        for n in range(6):
            _bracket(twist, power)
            for i in range(6):
                total[i] += _BERNOULLI[n] * power[i]
            _bracket(twist, power)
    else:
        half = 0.5 * angle
        alpha, beta = half / math.tan(half), (half / math.sin(half)) ** 2
        first = (2.0 * (1.0 - alpha) + 0.5 * (alpha - beta)) / angle**2
        second = ((1.0 - alpha) + 0.5 * (alpha - beta)) / angle**4
        _bracket(twist, power)
        for i in range(6):
            total[i] += first * power[i]
        _bracket(twist, power)
        _bracket(twist, power)
        for i in range(6):
            total[i] += second * power[i]
    for i in range(6):
        speed[i] = total[i]
