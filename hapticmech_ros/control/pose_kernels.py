# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Poses inside kernels: the logarithm, and the error between device and operational point.

Control laws in Python have :mod:`~hapticmech_ros.control.clutch` and
:mod:`~hapticmech_ros.control.prediction` for the same. Rotations are quaternions x, y, z, w here,
as they come: of any length but 0. Two that are equal then differ by no rotation at all, to the bit,
so a device at rest on a mechanism at rest is left at rest.
"""

from __future__ import annotations

import numpy as np

from hapticmech_ros.arrays import Array
from hapticmech_ros.compilation import inner, local, shaped
from hapticmech_ros.mechanism.kernels.small_matrices import cross

# Below this θ², rad², three terms of a series are exact to rounding.
SMALL_SQUARE = 1e-3


@inner
def follow(second: Array, first: Array, out: Array) -> None:
    """Put the rotation by ``first``, then by ``second``, into ``out``, which is neither of them."""
    cross(second[:3], first[:3], out[:3])
    for i in range(3):
        out[i] += second[3] * first[i] + second[i] * first[3]
    along = second[0] * first[0] + second[1] * first[1] + second[2] * first[2]
    out[3] = second[3] * first[3] - along


@inner
def turn_between(start: Array, end: Array, out: Array) -> None:
    """Put the rotation, world axes, that takes ``start`` to ``end`` into ``out``, neither of them.

    Zero to the bit where they are equal: products cancel in pairs.
    """
    cross(start[:3], end[:3], out[:3])
    for i in range(3):
        out[i] += end[i] * start[3] - end[3] * start[i]
    along = end[0] * start[0] + end[1] * start[1] + end[2] * start[2]
    out[3] = end[3] * start[3] + along


@inner
def log6(rotation: Array, translation: Array, out: Array) -> None:
    """Fill ``out`` (6,) with the logarithm of a pose: V⁻¹(ω) t, then ω; m and rad, 0 ≤ θ ≤ π.

    V⁻¹(ω) t = t - ½ ω × t + β ω × (ω × t),   β = (1 - θ/2 cot θ/2) / θ²

    Args:
        rotation: (4,) quaternion.
        translation: (3,) m.
        out: to fill.
    """
    linear, angle = out[:3], out[3:]
    x, y, z, cosine = rotation[0], rotation[1], rotation[2], rotation[3]
    sine = np.sqrt(x * x + y * y + z * z)
    # q and -q are one rotation.
    half = np.arctan2(sine, abs(cosine))
    ratio = 2.0 * half / sine if sine > 0.0 else 2.0 / abs(cosine)
    if cosine < 0.0:
        ratio = -ratio
    angle[0], angle[1], angle[2] = ratio * x, ratio * y, ratio * z
    square = 4.0 * half * half
    if square < SMALL_SQUARE:
        beta = 1.0 / 12.0 + square * (1.0 / 720.0 + square / 30240.0)
    else:
        beta = (1.0 - half * abs(cosine) / sine) / square
    turned = shaped(local(2 * 3), (2, 3))
    cross(angle, translation, turned[0])
    cross(angle, turned[0], turned[1])
    for i in range(3):
        linear[i] = translation[i] - 0.5 * turned[0, i] + beta * turned[1, i]


@inner
def carry_on(place: Array, twist: Array, duration: float, out: Array) -> None:
    """Fill ``out`` (7,) with where a frame is after ``duration`` (s).

    Args:
        place: (7,) its position, m, and quaternion.
        twist: (6,) of its origin, constant, world axes, m/s and rad/s.
        duration: s, may be negative.
        out: to fill, as ``place``.
    """
    turn = local(4)
    x, y, z = duration * twist[3], duration * twist[4], duration * twist[5]
    angle = np.sqrt(x * x + y * y + z * z)
    ratio = np.sin(0.5 * angle) / angle if angle > 0.0 else 0.5
    turn[0], turn[1], turn[2], turn[3] = ratio * x, ratio * y, ratio * z, np.cos(0.5 * angle)
    follow(turn, place[3:7], out[3:])
    for i in range(3):
        out[i] = place[i] + duration * twist[i]


@inner
def clutch_error(
    clutch: Array, device: Array, place: Array, twist: Array, ahead: float, error: Array
) -> None:
    """Fill ``error`` (6,) with e, from the point, carried on, to the device through the clutch.

    In world axes log(point⁻¹ device) is the logarithm of the rotation from one to the other and of
    the translation from origin to origin.

    Args:
        clutch: (7,) displacement of the clutch, and quaternion of its turn.
        device: (7,) its position and quaternion.
        place: (7,) the point's.
        twist: (6,) the point's, world axes.
        ahead: s, for which the point is carried on.
        error: to fill, m and rad.
    """
    point, mapped, between, way = local(7), local(4), local(4), local(3)
    carry_on(place, twist, ahead, point)
    follow(device[3:7], clutch[3:7], mapped)
    turn_between(point[3:], mapped, between)
    for i in range(3):
        way[i] = device[i] + clutch[i] - point[i]
    log6(between, way, error)


@inner
def displacement(start: Array, end: Array, way: Array) -> None:
    """Fill ``way`` (6,) with the way from one pose to another, world axes; m and rad.

    The translation from origin to origin, and the rotation vector of end start⁻¹. Equal poses
    differ by nothing, to the bit.

    Args:
        start: (7,) or more, position and unit quaternion x, y, z, w first.
        end: the same, later.
        way: to fill.
    """
    turn = local(4)
    turn_between(start[3:7], end[3:7], turn)
    x, y, z, cosine = turn[0], turn[1], turn[2], turn[3]
    sine = np.sqrt(x * x + y * y + z * z)
    scale = 2.0 * np.arctan2(sine, abs(cosine)) / sine if sine > 0.0 else 0.0
    # q and -q are one rotation.
    if cosine < 0.0:
        scale = -scale
    for i in range(3):
        way[i] = end[i] - start[i]
        way[3 + i] = scale * turn[i]
