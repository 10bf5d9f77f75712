# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Rotations inside kernels: products, exponential, logarithm, quaternions.

Matrices are (3, 3), vectors (3,), quaternions (4,) x, y, z, w. Formulas and conventions are those
of Pinocchio and Eigen, so that results equal theirs to rounding. No function allocates; ``out`` is
overwritten and must not share memory with an argument, unless it is said that it may.
"""

from __future__ import annotations

import numpy as np

from hapticmech_ros.compilation import inner
from hapticmech_ros.numerics import Array

EPSILON = 2.220446049250313e-16
# Below this angle, rad, four terms of a series are exact to rounding.
SMALL_ANGLE = EPSILON**0.25


@inner
def multiply(a: Array, b: Array, out: Array) -> None:
    """Put the product a b of two matrices into ``out``."""
    for i in range(3):
        for j in range(3):
            out[i, j] = a[i, 0] * b[0, j] + a[i, 1] * b[1, j] + a[i, 2] * b[2, j]


@inner
def multiply_transposed(a: Array, b: Array, out: Array) -> None:
    """Put a bᵀ into ``out``."""
    for i in range(3):
        for j in range(3):
            out[i, j] = a[i, 0] * b[j, 0] + a[i, 1] * b[j, 1] + a[i, 2] * b[j, 2]


@inner
def exp3(vector: Array, out: Array) -> None:
    """Fill ``out`` with the rotation by a rotation vector θ u, rad.

    exp = 1 + sin θ [u] + (1 - cos θ) [u]²
    """
    x, y, z = vector[0], vector[1], vector[2]
    square = x * x + y * y + z * z + EPSILON * EPSILON
    angle = np.sqrt(square)
    if angle > SMALL_ANGLE:
        cosine = np.cos(angle)
        along, across = (1.0 - cosine) / square, np.sin(angle) / angle
    else:
        along, across = 0.5 - square / 24.0, 1.0 - square / 6.0
        cosine = 1.0 - square / 2.0
    for i in range(3):
        for j in range(3):
            out[i, j] = along * vector[i] * vector[j]
        out[i, i] += cosine
    out[0, 1] -= across * z
    out[1, 0] += across * z
    out[0, 2] += across * y
    out[2, 0] -= across * y
    out[1, 2] -= across * x
    out[2, 1] += across * x


@inner
def angular_rate(vector: Array, rate: Array, out: Array) -> None:
    """Fill ``out`` with the angular velocity, world axes, of exp(vector) while vector changes.

    That is J(v) v̇ with J the left Jacobian, sin θ/θ + (1 - cos θ)/θ² [v] + (1 - sin θ/θ)/θ² v vᵀ.
    ``rate`` is v̇, rad/s.
    """
    x, y, z = vector[0], vector[1], vector[2]
    square = x * x + y * y + z * z
    angle = np.sqrt(square)
    if angle < SMALL_ANGLE:
        kept, turned = 1.0 - square / 6.0, 0.5 - square / 24.0
        along = 1.0 / 6.0 - square / 120.0
    else:
        kept, turned = np.sin(angle) / angle, (1.0 - np.cos(angle)) / square
        along = (1.0 - kept) / square
    along *= x * rate[0] + y * rate[1] + z * rate[2]
    out[0] = kept * rate[0] + turned * (y * rate[2] - z * rate[1]) + along * x
    out[1] = kept * rate[1] + turned * (z * rate[0] - x * rate[2]) + along * y
    out[2] = kept * rate[2] + turned * (x * rate[1] - y * rate[0]) + along * z


@inner
def log3(matrix: Array, out: Array) -> None:
    """Fill ``out`` with the rotation vector of a rotation, 0 ≤ θ ≤ π rad.

    As Pinocchio does, it first makes the matrix orthogonal: the second column is kept, made a unit
    vector, and the first is turned about the third. At θ = π exactly, the largest component of
    the vector is positive. Exact to rounding at every angle, also just below π.
    """
    x0, x1, x2 = _unit(matrix[0, 0], matrix[1, 0], matrix[2, 0])
    y0, y1, y2 = _unit(matrix[0, 1], matrix[1, 1], matrix[2, 1])
    z0, z1, z2 = x1 * y2 - x2 * y1, x2 * y0 - x0 * y2, x0 * y1 - x1 * y0
    x0, x1, x2 = y1 * z2 - y2 * z1, y2 * z0 - y0 * z2, y0 * z1 - y1 * z0
    x, y, z, w = _quaternion(x0, y0, z0, x1, y1, z1, x2, y2, z2)
    log_quaternion(x, y, z, w, out)


@inner
def log_quaternion(x: float, y: float, z: float, w: float, out: Array) -> None:
    """Fill ``out`` with the rotation vector of a unit quaternion, rad; of the two the shorter."""
    if w < 0.0:
        x, y, z, w = -x, -y, -z, -w
    sine = np.sqrt(x * x + y * y + z * z)
    ratio = 2.0 * np.arctan2(sine, w) / sine if sine > 0.0 else 2.0
    out[0], out[1], out[2] = ratio * x, ratio * y, ratio * z


@inner
def quaternion_of(matrix: Array, out: Array) -> None:
    """Fill ``out`` with the quaternion of a rotation, as Eigen does.

    The sign is not fixed: w > 0 where the trace is positive; elsewhere the largest of x, y, z is
    positive and w may be negative.
    """
    out[0], out[1], out[2], out[3] = _quaternion(
        matrix[0, 0],
        matrix[0, 1],
        matrix[0, 2],
        matrix[1, 0],
        matrix[1, 1],
        matrix[1, 2],
        matrix[2, 0],
        matrix[2, 1],
        matrix[2, 2],
    )


@inner
def rotation_of(quaternion: Array, out: Array) -> None:
    """Fill ``out`` with the rotation of a quaternion of any length but 0: it is divided by it."""
    x, y, z, w = quaternion[0], quaternion[1], quaternion[2], quaternion[3]
    length = np.sqrt(x * x + y * y + z * z + w * w)
    x, y, z, w = x / length, y / length, z / length, w / length
    tx, ty, tz = 2.0 * x, 2.0 * y, 2.0 * z
    out[0, 0], out[0, 1], out[0, 2] = 1.0 - (ty * y + tz * z), ty * x - tz * w, tz * x + ty * w
    out[1, 0], out[1, 1], out[1, 2] = ty * x + tz * w, 1.0 - (tx * x + tz * z), tz * y - tx * w
    out[2, 0], out[2, 1], out[2, 2] = tz * x - ty * w, tz * y + tx * w, 1.0 - (tx * x + ty * y)


@inner
def _unit(x: float, y: float, z: float) -> tuple[float, float, float]:
    length = np.sqrt(x * x + y * y + z * z)
    return x / length, y / length, z / length


@inner
def _quaternion(
    xx: float,
    xy: float,
    xz: float,
    yx: float,
    yy: float,
    yz: float,
    zx: float,
    zy: float,
    zz: float,
) -> tuple[float, float, float, float]:
    """Return x, y, z, w of a matrix given row by row, dividing by its largest part."""
    trace = xx + (yy + zz)
    if trace > 0.0:
        root = np.sqrt(trace + 1.0)
        half = 0.5 / root
        return (zy - yz) * half, (xz - zx) * half, (yx - xy) * half, 0.5 * root
    if zz > max(xx, yy):
        root = np.sqrt(zz - xx - yy + 1.0)
        half = 0.5 / root
        return (xz + zx) * half, (yz + zy) * half, 0.5 * root, (yx - xy) * half
    if yy > xx:
        root = np.sqrt(yy - zz - xx + 1.0)
        half = 0.5 / root
        return (yx + xy) * half, 0.5 * root, (zy + yz) * half, (xz - zx) * half
    root = np.sqrt(xx - yy - zz + 1.0)
    half = 0.5 / root
    return 0.5 * root, (yx + xy) * half, (zx + xz) * half, (zy - yz) * half
