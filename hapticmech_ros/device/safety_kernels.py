# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The safety envelope in kernels: see :mod:`~hapticmech_ros.device.safety`."""

from __future__ import annotations

from enum import Enum

import numpy as np

from hapticmech_ros.compilation import inner, local, put
from hapticmech_ros.compilation.records import Number, Record, Vector
from hapticmech_ros.numerics import Array
from hapticmech_ros.numerics.small_matrices import subtract3


class Reason(str, Enum):
    """Why a device limits its command."""

    WORKSPACE = "workspace"
    FORCE_LIMIT = "force_limit"
    TORQUE_LIMIT = "torque_limit"
    FORCE_SLEW = "force_slew"
    TORQUE_SLEW = "torque_slew"
    NOT_FINITE = "not_finite"

    @property
    def counted_as(self) -> str:
        """Name of the number of samples that it has changed, in :class:`Safety`."""
        return f"limited_by_{self.value}"


class Safety(Record):
    """The safety envelope of a device.

    Attributes:
        force, torque, force_slew, torque_slew, ramp, radius: as of ``SafetyLimits``.
        period: of a sample, s.
        centre: of the workspace, m.
        last: wrench that left last, N and N m, world axes.
        started: samples since the start.
        limited_by_workspace, limited_by_force_limit, limited_by_torque_limit,
            limited_by_force_slew, limited_by_torque_slew, limited_by_not_finite: samples that each
            :class:`Reason` has changed.
    """

    force = Number()
    torque = Number()
    force_slew = Number()
    torque_slew = Number()
    ramp = Number()
    radius = Number()
    period = Number()
    centre = Vector(3)
    last = Vector(6)
    started = Number()
    limited_by_workspace = Number()
    limited_by_force_limit = Number()
    limited_by_torque_limit = Number()
    limited_by_force_slew = Number()
    limited_by_torque_slew = Number()
    limited_by_not_finite = Number()


# From this share of the workspace's radius on, an outward force is taken away, all of it at 1.
EDGE = 0.9


@inner
def length_of(vector: Array) -> float:
    """Return the length of a vector (3,) of any finite numbers: squares of large ones overflow."""
    largest = max(abs(vector[0]), abs(vector[1]), abs(vector[2]))
    if largest == 0.0:
        return 0.0
    x, y, z = vector[0] / largest, vector[1] / largest, vector[2] / largest
    return float(largest * np.sqrt(x * x + y * y + z * z))


@inner
def turn_inwards(safety: Safety, force: Array, position: Array) -> None:
    """Take the outward part of a force (3,) away near the end of the workspace."""
    square, outward, centre = 0.0, 0.0, safety.centre
    for i in range(3):
        away = position[i] - centre[i]
        square += away * away
        outward += away * force[i]
    distance = np.sqrt(square)
    beyond = (distance / safety.radius - EDGE) / (1.0 - EDGE)
    if beyond <= 0.0 or outward <= 0.0:
        return
    safety.limited_by_workspace += 1.0
    share = min(beyond, 1.0) * outward / square
    for i in range(3):
        force[i] -= share * (position[i] - centre[i])


@inner
def exceeds(vector: Array, most: float) -> bool:
    """Shorten a force or a torque (3,) to its limit, and return whether it was longer."""
    size = length_of(vector)
    if size <= most:
        return False
    for i in range(3):
        vector[i] *= most / size
    return True


@inner
def jumps(vector: Array, last: Array, most: float) -> bool:
    """Limit the change of a force or a torque (3,) to ``most``; return whether it was larger."""
    change = local(3)
    subtract3(vector, last, change)
    size = length_of(change)
    if size <= most:
        return False
    for i in range(3):
        vector[i] = last[i] + most / size * change[i]
    return True


@inner
def keep_bounds(safety: Safety, command: Array, position: Array) -> None:
    """Keep a command (6,) within the workspace and within its force and torque limits."""
    share, force, torque = 1.0, command[:3], command[3:]
    if safety.ramp > 0.0:
        share = min(1.0, safety.started * safety.period / safety.ramp)
    if safety.radius < np.inf:
        turn_inwards(safety, force, position)
    if exceeds(force, share * safety.force):
        safety.limited_by_force_limit += 1.0
    if exceeds(torque, share * safety.torque):
        safety.limited_by_torque_limit += 1.0


@inner
def is_finite(safety: Safety, command: Array) -> bool:
    """Return whether a command (6,) is finite; else make it zero, count it, and begin anew."""
    finite = True
    for i in range(6):
        finite = finite and np.isfinite(command[i])
    if not finite:
        safety.limited_by_not_finite += 1.0
        safety.last[:] = 0.0
        safety.started = 0.0
        command[:] = 0.0
    return bool(finite)


@inner
def stay_within(safety: Safety, command: Array, position: Array) -> None:
    """Limit a command.

    Args:
        safety: changed.
        command: (6,) on the hand, by the device, at the point held, N and N m, world axes; changed.
        position: (3,) of that point, m, world axes.
    """
    if not is_finite(safety, command):
        return
    last = safety.last
    safety.started += 1.0
    keep_bounds(safety, command, position)
    if jumps(command[:3], last[:3], safety.force_slew * safety.period):
        safety.limited_by_force_slew += 1.0
    if jumps(command[3:], last[3:], safety.torque_slew * safety.period):
        safety.limited_by_torque_slew += 1.0
    put(last, command)


@inner
def stay_bounded(safety: Safety, command: Array, position: Array) -> None:
    """Limit a command (6,) that passivity control has changed after :func:`stay_within`.

    Its slew rate is not limited: passivity control only takes energy away, and must act at once.
    """
    if is_finite(safety, command):
        keep_bounds(safety, command, position)
        put(safety.last, command)
