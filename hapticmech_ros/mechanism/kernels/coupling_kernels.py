# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Couplings of two joints: one row θ - p(θ_leader), p a polynomial; see :mod:`closures`.

The place of a coupling's frame a is no frame's: it begins with p's five coefficients, the constant
first. Nor is its pose, which begins with p's slope and second derivative at the configuration.
"""

from __future__ import annotations

from hapticmech_ros.arrays import Array
from hapticmech_ros.compilation import inner
from hapticmech_ros.mechanism.kernels.model import Model


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
