# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Couplings of two joints: one row θ - ratio θ_leader - offset, as :mod:`closures` defines it.

The place of a coupling's frame a is no frame's: it begins with ratio and offset.
"""

from __future__ import annotations

from hapticmech_ros.arrays import Array
from hapticmech_ros.compilation import inner
from hapticmech_ros.mechanism.kernels.model import Model


@inner
def gear_error(model: Model, a: int, b: int, q: Array) -> float:
    """Return φ of the joints that carry frames a and b, rad or m."""
    joints, carriers, gear = model.joints, model.carriers, model.placements[a]
    return float(q[joints[carriers[a], 4]] - gear[0] * q[joints[carriers[b], 4]] - gear[1])


@inner
def gear_speed(model: Model, a: int, b: int, v: Array) -> float:
    """Return φ̇, rad/s or m/s."""
    joints, carriers, gear = model.joints, model.carriers, model.placements[a]
    return float(v[joints[carriers[a], 1]] - gear[0] * v[joints[carriers[b], 1]])


@inner
def add_gear(model: Model, a: int, b: int, row: Array) -> None:
    """Add the row of W to ``row`` (nv,)."""
    joints, carriers = model.joints, model.carriers
    row[joints[carriers[a], 1]] += 1.0
    row[joints[carriers[b], 1]] -= model.placements[a, 0]
