# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Joint-constraint gains of a scene that gives none: the same rule for every device.

    k = min(2000 N/m, m (0.3 / τ)²),      b = 2 ζ √(k m),      ζ = 0.8

Along a constrained direction a hand feels the device's own mass m, on a spring that is closed after
τ: a period of sampling and hold, the lag of the velocity filter where encoders are stepped, and,
where the device does not close it itself, one more and the connection there and back. ω τ = 0.3
leaves a margin of three to where such a loop becomes unstable; 2000 N/m gives way by a millimetre
under 2 N.

Spring and damper scale alike with the metric's lengths, so where the device turns, its felt inertia
and with it the critical damping are smaller: of the scenes that are shipped, ζ = 0.8 in translation
is up to 1.3 there. One is critical on average, and neither rings.
"""

from __future__ import annotations

import math

from hapticmech_ros.scene.controller import Connection, JointConstraintGains
from hapticmech_ros.scene.device import Device

MOST_N_PER_M = 2000.0
# Phase lag ω τ (rad) of a delayed spring by design; it becomes unstable at about three times that.
DESIGN_PHASE_LAG = 0.3
DAMPING_RATIO = 0.8


def lag_of(device: Device, connection: Connection, period: float, local: bool) -> float:
    """Return τ, s, of a spring between device and operational point.

    Args:
        device: whose velocity may be filtered.
        connection: between device and controller.
        period: s.
        local: whether the device closes it itself.
    """
    lag = period
    if device.position_resolution > 0.0 or device.angle_resolution > 0.0:
        lag += 1.0 / (2.0 * math.pi * device.velocity_filter)
    return lag if local else lag + period + 2.0 * connection.designed


def damping_for(stiffness: float, device: Device) -> float:
    """Return b, N s/m, that goes with a stiffness, N/m."""
    return 2.0 * DAMPING_RATIO * math.sqrt(stiffness * device.mass)


def by_rule(
    gains: JointConstraintGains, device: Device, connection: Connection, period: float
) -> JointConstraintGains:
    """Return gains with stiffness and damping by the rule, where they were not given."""
    given = gains.model_fields_set
    if {"stiffness", "damping"} <= given:
        return gains
    lag = lag_of(device, connection, period, gains.local)
    stiffness = gains.stiffness
    if "stiffness" not in given:
        stiffness = min(MOST_N_PER_M, device.mass * (DESIGN_PHASE_LAG / lag) ** 2)
    damping = gains.damping
    if "damping" not in given:
        damping = damping_for(stiffness, device)
    return gains.model_copy(update={"stiffness": stiffness, "damping": damping})
