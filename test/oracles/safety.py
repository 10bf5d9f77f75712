# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Last before a force leaves: what a device gives of what it is told to give.

A command within all limits passes unchanged, to the bit. Else, in this order: the outward part of
the force is taken away near the end of the workspace; force and torque are shortened to their
limits, which open over a ramp after each start; and neither changes faster than its slew rate. A
command that is none, and a stop, are zero at once.
"""

from __future__ import annotations

import math

import numpy as np

from hapticmech_ros.arrays import Array
from hapticmech_ros.device.safety import Reason, SafetyLimits

# From this share of the workspace's radius on, an outward force is taken away, all of it at 1.
EDGE = 0.9
# Three numbers: small arrays take ten times as long.
Vector = tuple[float, float, float]
_NOTHING: Vector = (0.0, 0.0, 0.0)


class SafetyEnvelope:
    """Applies :class:`SafetyLimits` sample by sample.

    Args:
        period: s, of a sample.

    Attributes:
        counts: samples in which each reason changed the command.
    """

    def __init__(self, period: float) -> None:
        self.counts = dict.fromkeys(Reason, 0)
        self._period = period
        self._centre = np.zeros(3)
        self._force = self._torque = _NOTHING
        self._started = 0

    def place(self, centre: Array) -> None:
        """Put the workspace's centre (3,), m."""
        self._centre = np.array(centre, dtype=float)

    def stop(self) -> Array:
        """Return zero (6,); the next command is a start."""
        self._started = 0
        self._force = self._torque = _NOTHING
        return np.zeros(6)

    def apply(self, limits: SafetyLimits, command: Array, position: Array) -> Array:
        """Return what leaves (6,) for a command (6,), N and N m, world axes.

        Args:
            limits: as they are now.
            command: on the hand, by the device, at the point held.
            position: (3,) of that point, m.
        """
        x, y, z, a, b, c = command.tolist()
        if not math.isfinite(x + y + z + a + b + c) and not np.isfinite(command).all():
            self.counts[Reason.NOT_FINITE] += 1
            return self.stop()
        self._started += 1
        force, torque = self._bounded(limits, command, position)
        force = self._slewed(force, self._force, limits.force_slew, Reason.FORCE_SLEW)
        torque = self._slewed(torque, self._torque, limits.torque_slew, Reason.TORQUE_SLEW)
        self._force, self._torque = force, torque
        return np.array((*force, *torque))

    def bound(self, limits: SafetyLimits, command: Array, position: Array) -> Array:
        """Return what leaves of a command that was changed after :meth:`apply`, at any rate."""
        if not np.isfinite(command).all():
            self.counts[Reason.NOT_FINITE] += 1
            return self.stop()
        self._force, self._torque = self._bounded(limits, command, position)
        return np.array((*self._force, *self._torque))

    def _bounded(
        self, limits: SafetyLimits, command: Array, position: Array
    ) -> tuple[Vector, Vector]:
        share = min(1.0, self._started * self._period / limits.ramp) if limits.ramp else 1.0
        x, y, z, a, b, c = command.tolist()
        force, torque = (x, y, z), (a, b, c)
        if limits.radius < math.inf:
            force = self._inwards(force, position, limits.radius)
        force = self._within(force, share * limits.force, Reason.FORCE_LIMIT)
        return force, self._within(torque, share * limits.torque, Reason.TORQUE_LIMIT)

    def _inwards(self, force: Vector, position: Array, radius: float) -> Vector:
        away = position - self._centre
        distance = math.sqrt(away @ away)
        beyond = (distance / radius - EDGE) / (1.0 - EDGE)
        if beyond <= 0.0:
            return force
        outward = float(away @ force) / distance
        if outward <= 0.0:
            return force
        self.counts[Reason.WORKSPACE] += 1
        return _less(force, away.tolist(), min(beyond, 1.0) * outward / distance)

    def _within(self, vector: Vector, limit: float, reason: Reason) -> Vector:
        size = math.hypot(*vector)
        if size <= limit:
            return vector
        self.counts[reason] += 1
        return _less(_NOTHING, vector, -limit / size)

    def _slewed(self, vector: Vector, last: Vector, rate: float, reason: Reason) -> Vector:
        change = _less(vector, last, 1.0)
        size, most = math.hypot(*change), rate * self._period
        if size <= most:
            return vector
        self.counts[reason] += 1
        return _less(last, change, -most / size)


def _less(vector: Vector, other: Vector, times: float) -> Vector:
    """Return a vector less so many times another one."""
    (x, y, z), (a, b, c) = vector, other
    return x - times * a, y - times * b, z - times * c
