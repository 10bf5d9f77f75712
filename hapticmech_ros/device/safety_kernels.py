# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The safety envelope in kernels: see :mod:`~hapticmech_ros.device.safety`."""

from __future__ import annotations

from enum import Enum

import numpy as np

from hapticmech_ros.compilation import inner, kernel, local, put
from hapticmech_ros.numerics import Array
from hapticmech_ros.numerics.layout import Field, Layout


class Reason(str, Enum):
    """Why a device does not give what it is told to give."""

    WORKSPACE = "workspace"
    FORCE_LIMIT = "force_limit"
    TORQUE_LIMIT = "torque_limit"
    FORCE_SLEW = "force_slew"
    TORQUE_SLEW = "torque_slew"
    NOT_FINITE = "not_finite"


_ONE = Field(1)
# Limits, as SafetyLimits has them; period of a sample, s; centre of the workspace, m; wrench that
# left last; samples since the start; and samples that each reason has changed.
SAFETY = Layout(
    {
        **dict.fromkeys(("force", "torque", "force_slew", "torque_slew", "ramp", "radius"), _ONE),
        "period": _ONE,
        "centre": Field(3),
        "last": Field(6),
        "started": _ONE,
        **{f"limited_by_{reason.value}": _ONE for reason in Reason},
    }
)


# From this share of the workspace's radius on, an outward force is taken away, all of it at 1.
EDGE = 0.9
FORCE, TORQUE, FORCE_SLEW, TORQUE_SLEW, RAMP, RADIUS, PERIOD, CENTRE, LAST, STARTED = SAFETY.starts(
    *("force", "torque", "force_slew", "torque_slew", "ramp", "radius"),
    *("period", "centre", "last", "started"),
)
BY_WORKSPACE, BY_FORCE, BY_TORQUE, BY_FORCE_SLEW, BY_TORQUE_SLEW, NOT_FINITE = SAFETY.starts(
    *("limited_by_workspace", "limited_by_force_limit", "limited_by_torque_limit"),
    *("limited_by_force_slew", "limited_by_torque_slew", "limited_by_not_finite"),
)


@inner
def length_of(vector: Array) -> float:
    """Return the length of a vector (3,) of any finite numbers: squares of large ones overflow."""
    largest = max(abs(vector[0]), abs(vector[1]), abs(vector[2]))
    if largest == 0.0:
        return 0.0
    x, y, z = vector[0] / largest, vector[1] / largest, vector[2] / largest
    return float(largest * np.sqrt(x * x + y * y + z * z))


@inner
def turn_inwards(safety: Array, force: Array, position: Array) -> None:
    """Take the outward part of a force (3,) away near the end of the workspace."""
    square, outward = 0.0, 0.0
    for i in range(3):
        away = position[i] - safety[CENTRE + i]
        square += away * away
        outward += away * force[i]
    distance = np.sqrt(square)
    beyond = (distance / safety[RADIUS] - EDGE) / (1.0 - EDGE)
    if beyond <= 0.0 or outward <= 0.0:
        return
    safety[BY_WORKSPACE] += 1.0
    share = min(beyond, 1.0) * outward / square
    for i in range(3):
        force[i] -= share * (position[i] - safety[CENTRE + i])


@inner
def keep_within(safety: Array, vector: Array, most: float, reason: int) -> None:
    """Shorten a force or a torque (3,) to its limit, and count it."""
    size = length_of(vector)
    if size <= most:
        return
    safety[reason] += 1.0
    for i in range(3):
        vector[i] *= most / size


@inner
def keep_slew(safety: Array, vector: Array, last: Array, rate: float, reason: int) -> None:
    """Let a force or a torque (3,) change by no more than its slew rate, and count it."""
    change, most = local(3), rate * safety[PERIOD]
    for i in range(3):
        change[i] = vector[i] - last[i]
    size = length_of(change)
    if size <= most:
        return
    safety[reason] += 1.0
    for i in range(3):
        vector[i] = last[i] + most / size * change[i]


@inner
def keep_bounds(safety: Array, command: Array, position: Array) -> None:
    """Keep a command (6,) within the workspace and within its force and torque limits."""
    share, force, torque = 1.0, command[:3], command[3:]
    if safety[RAMP] > 0.0:
        share = min(1.0, safety[STARTED] * safety[PERIOD] / safety[RAMP])
    if safety[RADIUS] < np.inf:
        turn_inwards(safety, force, position)
    keep_within(safety, force, share * safety[FORCE], BY_FORCE)
    keep_within(safety, torque, share * safety[TORQUE], BY_TORQUE)


@inner
def is_finite(safety: Array, command: Array) -> bool:
    """Return whether a command (6,) is one; else make it zero, count it, and begin anew."""
    finite = True
    for i in range(6):
        finite = finite and np.isfinite(command[i])
    if not finite:
        safety[NOT_FINITE] += 1.0
        safety[LAST : STARTED + 1] = 0.0
        command[:] = 0.0
    return bool(finite)


@inner
def stay_within(safety: Array, command: Array, position: Array) -> None:
    """Change a command (6,) into what leaves; see :func:`apply_envelope`."""
    if not is_finite(safety, command):
        return
    last = safety[LAST:STARTED]
    safety[STARTED] += 1.0
    keep_bounds(safety, command, position)
    keep_slew(safety, command[:3], last[:3], safety[FORCE_SLEW], BY_FORCE_SLEW)
    keep_slew(safety, command[3:], last[3:], safety[TORQUE_SLEW], BY_TORQUE_SLEW)
    put(last, command)


@inner
def stay_bounded(safety: Array, command: Array, position: Array) -> None:
    """Change a command (6,) that passivity control changed after :func:`stay_within`.

    It may change at any rate: it only takes energy away, and later is too late for that.
    """
    if is_finite(safety, command):
        keep_bounds(safety, command, position)
        put(safety[LAST:STARTED], command)


@kernel("void(float64[::1], float64[::1], float64[::1])")
def apply_envelope(safety: Array, command: Array, position: Array) -> None:
    """Change a command into what leaves.

    Args:
        safety: (numbers,) the envelope, changed; see ``safety_layout``.
        command: (6,) on the hand, by the device, at the point held, N and N m, world axes; changed.
        position: (3,) of that point, m, world axes.
    """
    stay_within(safety, command, position)
