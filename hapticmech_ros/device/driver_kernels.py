# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What a device's driver does at the sample rate: compensation before, force sensing after.

The hand's wrench without a sensor is a momentum observer's, from encoders and actuators. Momentum
p = Λ_d v changes by all that acts. What is known of it, actuators u, weight w, viscous damping b v
and friction f, is taken off, and the rest is passed through a low-pass r:

    ṙ = ω (ṗ - u - w + b v + f - r),      ω = 2 π bandwidth

over a period T, with means of the period and the exact step of the low-pass,

    r⁺ = r + (1 - e^(-ω T)) (Λ_d (v⁺ - v) / T - u - w + b (v + v⁺) / 2 + f - r)

(after De Luca and Mattone, "Sensorless robot collision detection and hybrid force/motion control",
ICRA 2005, here for a body in Cartesian space). A constant wrench is found without bias, a sinusoid
of frequency f Hz lags by arctan(f / bandwidth) and half a period. What the model does not know is
taken for the hand: Coulomb friction beyond its compensated share, end stops, an error of the mass.
"""

from __future__ import annotations

import numpy as np

from hapticmech_ros.arrays import Array
from hapticmech_ros.compilation import inner, local
from hapticmech_ros.device.device_layout import DEVICE_MODEL, DEVICE_STATE
from hapticmech_ros.mechanism.kernels.small_matrices import dot
from hapticmech_ros.saturation_kernels import limit

PERIOD, MOST_FORCE, MOST_TORQUE = DEVICE_MODEL.starts("period", "force_limit", "torque_limit")
FRICTION, TURN_FRICTION, DAMPING, COMMAND, WEIGHT, TASK = DEVICE_MODEL.starts(
    *("friction", "angular_friction", "damping", "command", "weight", "task")
)
ACTS, COMPENSATED, DEAD_ZONE, ANGULAR_DEAD_ZONE, LIFTS = DEVICE_MODEL.starts(
    *("acts", "compensated", "dead_zone", "angular_dead_zone", "lifts")
)
SENSES_ITSELF, OBSERVER_SHARE, ACTUATOR_SHARE, INERTIA = DEVICE_MODEL.starts(
    "senses_itself", "observer_share", "actuator_share", "inertia"
)
SPEED, REPORTED, APPLIED = DEVICE_STATE.starts("twist", "hand_wrench", "applied")
# Of what a device reports of its hand's wrench.
MEASURED, ESTIMATED, ABSENT = 0.0, 1.0, 2.0


@inner
def _add_friction(
    share: float, dead_zone: float, coulomb: float, damping: float, rate: Array, given: Array
) -> None:
    """Fill a share of friction's force or torque (3,) at a rate (3,), none in the dead zone."""
    speed = np.sqrt(dot(rate, rate))
    known = min(max(speed / dead_zone - 1.0, 0.0), 1.0)
    for i in range(3):
        given[i] = 0.0
        if known > 0.0:
            given[i] = share * (known * (coulomb / speed + damping) * rate[i])


@inner
def compensate(data: Array, twist: Array, added: Array) -> None:
    """Fill what the driver adds (6,) to a command, at a measured twist (6,)."""
    added[:] = 0.0
    if data[COMPENSATED] > 0.0:
        share, turning = data[COMPENSATED], data[ANGULAR_DEAD_ZONE]
        friction, damping = data[FRICTION], data[DAMPING]
        _add_friction(share, data[DEAD_ZONE], friction, damping, twist[:3], added[:3])
        friction, damping = data[TURN_FRICTION], data[DAMPING + 3]
        _add_friction(share, turning, friction, damping, twist[3:], added[3:])
    for i in range(6):
        added[i] = data[TASK + i] * (added[i] - data[LIFTS] * data[WEIGHT + i])


@inner
def estimate_hand(data: Array, before: Array, out: Array) -> None:
    """Fill what is reported of the hand without a sensor; r⁺ of the module.

    Args:
        data: the device, and what its actuators were asked for.
        before: its state at the period's start.
        out: its state at the end.
    """
    reported = out[REPORTED:APPLIED]
    if data[SENSES_ITSELF] == ABSENT:
        reported[:] = 0.0
        return
    mean, known = local(6), local(6)
    known[:] = 0.0
    for i in range(6):
        mean[i] = 0.5 * (before[SPEED + i] + out[SPEED + i])
    if data[COMPENSATED] > 0.0:
        share, turning = data[COMPENSATED], data[ANGULAR_DEAD_ZONE]
        _add_friction(share, data[DEAD_ZONE], data[FRICTION], 0.0, mean[:3], known[:3])
        _add_friction(share, turning, data[TURN_FRICTION], 0.0, mean[3:], known[3:])
    for i in range(6):
        asked = data[COMMAND + i]
        given = asked + data[ACTUATOR_SHARE] * (before[APPLIED + i] - asked)
        change = data[INERTIA + i] * (out[SPEED + i] - before[SPEED + i]) / data[PERIOD]
        pushed = change - given - data[TASK + i] * data[WEIGHT + i]
        resisted = data[DAMPING + i] * mean[i] + known[i]
        estimate = before[REPORTED + i]
        behind = data[TASK + i] * (pushed + resisted) - estimate
        reported[i] = estimate + data[OBSERVER_SHARE] * behind


@inner
def command_device(data: Array, state: Array, command: Array) -> None:
    """Ask actuators, within their limits, for a command (6,) and what is added at a state."""
    compensate(data, state[SPEED:REPORTED], data[COMMAND:WEIGHT])
    for i in range(6):
        asked = command[i] + data[COMMAND + i]
        data[COMMAND + i] = data[ACTS + i] * asked
    limit(data[COMMAND : COMMAND + 3], data[MOST_FORCE])
    limit(data[COMMAND + 3 : WEIGHT], data[MOST_TORQUE])
