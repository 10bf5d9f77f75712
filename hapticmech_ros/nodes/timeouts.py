# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Timeouts of the control loop, in periods: at each rate it is as far from breaking off. No ROS.

What is waited for comes once a period. A time that suits 1 kHz is a few periods of a slow loop, and
a machine's shortest pause would end it.
"""

from __future__ import annotations

import math
from typing import NamedTuple, Protocol

from hapticmech_ros.errors import InvalidInputError
from hapticmech_ros.scene.device import Device

# What comes once a period is sometimes late by one, and sometimes lost: a shorter timeout than so
# many periods cannot hold.
LEAST_PERIODS = 3
# Of a period: the rounding of a rate's period is no reason to refuse.
_ROUNDING = 1e-6


class ByRate(NamedTuple):
    """A time that follows the control rate.

    Attributes:
        periods: as many as it has.
        least: s, that it has at any rate: a short period does not shorten a machine's pauses.
    """

    periods: int
    least: float

    def at(self, period_s: float) -> float:
        """Return the time (s) at a control period, s."""
        return max(self.periods * period_s, self.least)

    def __str__(self) -> str:
        return f"{self.periods} periods, at least {1e3 * self.least:g} ms"


# How long a device acts on a command, and a controller on its inputs.
COMMAND = ByRate(12, 0.012)
# How long the mechanism acts on a command, and takes to ramp it to zero afterwards.
MECHANISM_COMMAND = ByRate(50, 0.05)
# Of the robot that follows: samples of its joints, of its target, and of its wrench sensor.
ROBOT_JOINTS, ROBOT_TARGET, ROBOT_WRENCH = ByRate(12, 0.02), ByRate(12, 0.05), ByRate(12, 0.05)
# Within this the device is without force after any node has died, or commands have ended.
ZERO_FORCE = ByRate(20, 0.02)


class HasLockstep(Protocol):
    """Parameters of a node, as far as they say whether timeouts count."""

    @property
    def lockstep(self) -> bool:
        """Whether the graph runs in lockstep, where none does."""


def timeout_of(
    parameters: HasLockstep,
    name: str,
    rule: ByRate,
    period_s: float,
    device: Device | None = None,
) -> float:
    """Return a timeout in s: as it was given, or by the rate, no longer than the scene allows.

    Args:
        parameters: of the node.
        name: of the timeout among them; where it is 0 it follows the rate.
        rule: by which it does.
        period_s: control period, s.
        device: whose ``safety.command_timeout`` it must not exceed; None: it has no such bound.

    Raises:
        InvalidInputError: longer than the scene allows, or less than three periods, which no graph
            in real time could hold.
    """
    given: float = getattr(parameters, name)
    bound = math.inf if device is None else device.safety.command_timeout
    if given > bound:
        limit = f"must be at most the scene's device.safety.command_timeout, {bound:g}"
        raise InvalidInputError(name, given, limit)
    seconds, least = given or min(rule.at(period_s), bound), LEAST_PERIODS * period_s
    if parameters.lockstep or seconds >= least * (1.0 - _ROUNDING):
        return seconds
    if given:
        limit = f"must be 0 or at least {LEAST_PERIODS} periods of {1.0 / period_s:g} Hz"
        raise InvalidInputError(name, given, f"{limit}, {least:g} s")
    limit = f"must be at least {LEAST_PERIODS} periods of {1.0 / period_s:g} Hz, {least:g} s"
    raise InvalidInputError("device.safety.command_timeout", bound, limit)
