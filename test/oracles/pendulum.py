# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Motions of one angle: a point mass on a rod, and parallelograms in a row."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.special import ellipj

from oracles.odes import solve

Array = np.ndarray
GRAVITY = 9.81


def turning(weight: float, angle: float, speed: float, times: Sequence[float]) -> Array:
    """Return theta (times,) of theta'' = -weight cos(theta), theta from the horizontal."""

    def rates(_: float, state: Array) -> Array:
        return np.array([state[1], -weight * np.cos(state[0])])

    return solve(rates, [angle, speed], times)[:, 0]


def let_go(length: float, times: Sequence[float]) -> Array:
    """Return positions (times, 2) of a point mass let go at (-length, 0), by Jacobi's functions.

    With phi from the hanging position, sin(phi / 2) = -k cd(w t), k = sin(pi / 4), w^2 = g / l.
    """
    modulus = np.sin(np.pi / 4.0)
    _, cn, dn, _ = ellipj(np.sqrt(GRAVITY / length) * np.asarray(times), modulus**2)
    half = np.arcsin(-modulus * cn / dn)
    return length * np.column_stack((np.sin(2.0 * half), -np.cos(2.0 * half)))


def windows(count: int, times: Sequence[float]) -> Array:
    """Return the tip of the first upright (times, 2) of ``count`` windows of rods (1 kg, 1 m).

    The count + 1 uprights share the angle theta, the tops only shift along the tips' circles:
    T = (count + 1) theta'^2 / 6 + count theta'^2 / 2, V = g sin(theta) ((count + 1) / 2 + count).
    """
    inertia = (count + 1) / 3.0 + count
    weight = GRAVITY * ((count + 1) / 2.0 + count)
    angle = turning(weight / inertia, np.pi / 2.0, -1.0, times)
    return np.column_stack((np.cos(angle), np.sin(angle)))
