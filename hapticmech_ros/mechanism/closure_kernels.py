"""Residual φ, Jacobian W and bias Ẇv of each kind of closure, as :mod:`closures` defines them.

A pose is a row of 12 numbers: the frame's three axes in the world, then its origin. Joint Jacobians
are rows of 6 per degree of freedom: velocity of what is at the world's origin, then angular rate.
"""

from __future__ import annotations

import numpy as np

from hapticmech_ros.compilation import inner
from hapticmech_ros.mechanism.model import Array
from hapticmech_ros.mechanism.small_matrices import cross, dot

SPHERICAL, REVOLUTE, WELD, PLANAR_PIN = 0, 1, 2, 3
KINDS = {"spherical": SPHERICAL, "revolute": REVOLUTE, "weld": WELD, "planar_pin": PLANAR_PIN}


@inner
def residual_of(kind: int, a: Array, b: Array, out: Array) -> None:
    """Fill ``out`` (m,) with φ of frames at poses ``a`` and ``b``."""
    points = 2 if kind == PLANAR_PIN else 3
    for i in range(points):
        out[i] = a[9 + i] - b[9 + i]
    if kind == REVOLUTE:
        out[3], out[4] = dot(b[0:3], a[6:9]), dot(b[3:6], a[6:9])
    elif kind == WELD:
        turn = np.empty(3)
        out[3:6] = 0.0
        for k in range(3):
            cross(b[3 * k : 3 * k + 3], a[3 * k : 3 * k + 3], turn)
            for i in range(3):
                out[3 + i] += 0.5 * turn[i]


@inner
def jacobian_of(
    kind: int,
    a: Array,
    b: Array,
    on_a: Array,
    on_b: Array,
    joint_jacobian: Array,
    out: Array,
) -> None:
    """Fill ``out`` (m, nv) with W; ``on_a`` and ``on_b`` (nv,) are 1 where a rate moves it."""
    points = 2 if kind == PLANAR_PIN else 3
    gain_a, gain_b = np.empty((3, 3)), np.empty((3, 3))
    turns = 0
    if kind == REVOLUTE:
        turns = 2
        for k in range(2):
            cross(a[6:9], b[3 * k : 3 * k + 3], gain_a[k])
            for i in range(3):
                gain_b[k, i] = -gain_a[k, i]
    elif kind == WELD:
        turns = 3
        _weld_gains(a, b, gain_a, gain_b)
    arm, moved = np.empty(3), np.empty(3)
    for c in range(on_a.size):
        column = joint_jacobian[c]
        for i in range(3):
            arm[i] = on_a[c] * a[9 + i] - on_b[c] * b[9 + i]
        cross(column[3:6], arm, moved)
        for i in range(points):
            out[i, c] = (on_a[c] - on_b[c]) * column[i] + moved[i]
        for i in range(turns):
            by_a, by_b = dot(gain_a[i], column[3:6]), dot(gain_b[i], column[3:6])
            out[points + i, c] = on_a[c] * by_a + on_b[c] * by_b


@inner
def bias_of(kind: int, a: Array, b: Array, motion_a: Array, motion_b: Array, out: Array) -> None:
    """Fill ``out`` (m,) with Ẇv.

    A motion (4, 3) is a frame's velocity and angular rate, then its acceleration and angular
    acceleration at v̇ = 0, world axes.
    """
    points = 2 if kind == PLANAR_PIN else 3
    for i in range(points):
        out[i] = motion_a[2, i] - motion_b[2, i]
    rates = np.empty((4, 3))
    if kind == REVOLUTE:
        z = a[6:9]
        _axis_rates(z, motion_a, rates[0], rates[1])
        for k in range(2):
            axis = b[3 * k : 3 * k + 3]
            _axis_rates(axis, motion_b, rates[2], rates[3])
            twice = 2.0 * dot(rates[2], rates[0])
            out[3 + k] = dot(rates[3], z) + twice + dot(axis, rates[1])
    elif kind == WELD:
        out[3:6] = 0.0
        turn = np.empty((3, 3))
        for k in range(3):
            of_a, of_b = a[3 * k : 3 * k + 3], b[3 * k : 3 * k + 3]
            _axis_rates(of_a, motion_a, rates[0], rates[1])
            _axis_rates(of_b, motion_b, rates[2], rates[3])
            cross(rates[3], of_a, turn[0])
            cross(rates[2], rates[0], turn[1])
            cross(of_b, rates[1], turn[2])
            for i in range(3):
                out[3 + i] += 0.5 * (turn[0, i] + 2.0 * turn[1, i] + turn[2, i])


@inner
def _axis_rates(axis: Array, motion: Array, first: Array, second: Array) -> None:
    """Fill first and second derivative of a unit axis at zero joint acceleration."""
    bend = np.empty(3)
    cross(motion[1], axis, first)
    cross(motion[1], first, bend)
    cross(motion[3], axis, second)
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
