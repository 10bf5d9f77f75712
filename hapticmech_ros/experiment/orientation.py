# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Interpolation of orientations over time, and angles between unit quaternions (x, y, z, w)."""

from __future__ import annotations

import numpy as np

from hapticmech_ros.arrays import Array

# Below this angle (rad) the chord is used for the arc; the relative difference is below 1e-17.
_SMALL = 1e-8


def angle_between(a: Array, b: Array) -> Array:
    """Return the angles (n,) in rad, 0 to pi, between orientations (n, 4) of either sign.

    They are computed from chords, so that small angles are accurate.

    Args:
        a: (n, 4) unit quaternions.
        b: (n, 4) unit quaternions.
    """
    apart = np.linalg.norm(a - b, axis=-1)
    across = np.linalg.norm(a + b, axis=-1)
    return np.asarray(4.0 * np.arctan2(np.minimum(apart, across), np.maximum(apart, across)))


def slerp(at: Array, times: Array, orientations: Array) -> Array:
    """Return orientations (m, 4) at times ``at`` (m,), on the shortest arc between neighbours.

    Args:
        at: (m,) s, within the span of ``times``; beyond it the first or last orientation holds.
        times: (n,) s, increasing.
        orientations: (n, 4) unit quaternions; at ``times`` they are returned unchanged.
    """
    if times.size == 1:
        return np.repeat(orientations, at.size, axis=0)
    left = np.clip(np.searchsorted(times, at, side="right") - 1, 0, times.size - 2)
    share = np.clip((at - times[left]) / (times[left + 1] - times[left]), 0.0, 1.0)
    a, b = orientations[left], orientations[left + 1]
    near = np.where(np.sum(a * b, axis=1, keepdims=True) < 0.0, -b, b)
    arc = angle_between(a, near) / 2.0
    safe = np.where(arc > _SMALL, arc, 1.0)
    weight_a = np.where(arc > _SMALL, np.sin((1.0 - share) * arc) / np.sin(safe), 1.0 - share)
    weight_b = np.where(arc > _SMALL, np.sin(share * arc) / np.sin(safe), share)
    mixed = weight_a[:, None] * a + weight_b[:, None] * near
    mixed /= np.linalg.norm(mixed, axis=1, keepdims=True)
    mixed[share == 0.0] = a[share == 0.0]
    mixed[share == 1.0] = b[share == 1.0]
    return np.asarray(mixed)
