# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Residual φ, Jacobian W and bias Ẇv of each kind of closure, as :mod:`closures` defines them.

A pose is a row of ``poses``, 12 numbers: a frame's three axes in the world, then its origin. A
rod's length is that of the first axis of its frame a. A coupling has a polynomial in the
place of that frame, and no wrenches: see ``pair_kernels``.
"""

from __future__ import annotations

import math

from hapticmech_ros.arrays import Array
from hapticmech_ros.compilation import inner, leaf, shaped
from hapticmech_ros.mechanism.kernels.pair_kernels import pull_between
from hapticmech_ros.mechanism.kernels.small_matrices import cross, dot

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

    A row's pair (see ``pair_kernels``) has the row's rate as its power.
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
