# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Flyball governor (IFToMM benchmark A05): spin psi', angle a of both arms, slider height s.

Arms hinge at (+-h, 0, 1) of the shaft and point a below the horizontal. The spin follows from
psi' Z(a) = constant, so that two coordinates remain, with psi'^2 Z'(a) / 2 as the spin's force.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from oracles.odes import solve_stiff

Array = np.ndarray

GRAVITY, DENSITY = 9.81, 3000.0
ARM, THICK, HINGE, CUBE, BALL = 1.0, 0.01, 0.05, 0.1, 5.0
STIFFNESS, DAMPING, REST = 8e5, 4e4, 0.5
SPIN, START_ANGLE, START_HEIGHT = 2.0 * np.pi, np.pi / 6.0, 0.5
ROD = DENSITY * ARM * THICK**2
SLIDER = DENSITY * CUBE**3
ALONG = ROD * THICK**2 / 6.0
ACROSS = ROD * (ARM**2 + THICK**2) / 12.0


def about_shaft(angle: float) -> tuple[float, float]:
    """Return the moment of inertia Z about the shaft and dZ/da, kg m^2."""
    cos, sin = np.cos(angle), np.sin(angle)
    moment = ALONG + SLIDER * CUBE**2 / 6.0 + 2.0 * (ALONG * sin**2 + ACROSS * cos**2)
    slope = 4.0 * (ALONG - ACROSS) * sin * cos
    for mass, distance in ((ROD, ARM / 2.0), (BALL, ARM)):
        reach = HINGE + distance * cos
        moment += 2.0 * mass * reach**2
        slope -= 4.0 * mass * reach * distance * sin
    return float(moment), float(slope)


def rates(_: float, state: Array) -> Array:
    """Return the derivative of (a, s, a', s')."""
    angle, height, turn, climb = state
    cos, sin = np.cos(angle), np.sin(angle)
    moment, slope = about_shaft(angle)
    spin = SPIN * about_shaft(START_ANGLE)[0] / moment
    across, down = 0.5 * ARM * cos, 1.0 - 0.5 * ARM * sin - height
    length = np.hypot(across, down)
    per_turn = 0.5 * ARM * (-across * sin - down * cos) / length
    per_climb = -down / length
    pull = STIFFNESS * (length - REST) + DAMPING * (per_turn * turn + per_climb * climb)
    # Per arm: weights pull a towards larger angles.
    inertia = ACROSS + ROD * ARM**2 / 4.0 + BALL * ARM**2
    weight = GRAVITY * cos * (ROD * ARM / 2.0 + BALL * ARM)
    turning = (weight + 0.25 * slope * spin**2 - pull * per_turn) / inertia
    climbing = -GRAVITY - 2.0 * pull * per_climb / SLIDER
    return np.array([turn, climb, turning, climbing])


def heights(times: Sequence[float]) -> Array:
    """Return the slider's height s (times,), m."""
    return solve_stiff(rates, [START_ANGLE, START_HEIGHT, 0.0, 0.0], times)[:, 1]
