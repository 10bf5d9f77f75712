# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Timeouts of the control loop, in periods: at each rate it is as far from breaking off. No ROS.

What is waited for comes once a period. A time that suits 1 kHz is a few periods of a slow loop, and
a machine's shortest pause would end it.

What an actor loses because nothing comes in time, and whether a pause explains it.

Pauses do if they make up half of the silence.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple, Protocol

from hapticmech_ros.errors import InvalidInputError
from hapticmech_ros.nodes.pauses import OwnPauses, Pauses, SenderPauses
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


class Losses:
    """Counts an actor's losses, and says what explains them.

    Args:
        own: pauses of this process.
        rate_hz: the control rate, Hz.
        say: warns.

    Attributes:
        count: losses.
        without_processor: of these, those that a pause of this process explains.
        sender_paused: those that a pause of the sender explains.
    """

    def __init__(self, own: OwnPauses, rate_hz: float, say: Callable[[str], None]) -> None:
        self._own, self._rate_hz, self._say = own, rate_hz, say
        self.count = self.without_processor = self.sender_paused = 0
        # What is not explained yet: who was silent since when, and the timeout.
        self._open: tuple[SenderPauses, int, int] | None = None

    def explained(
        self,
        silence_ns: int | None,
        timeout_ns: int,
        now_ns: int,
        sender: SenderPauses | None = None,
    ) -> str:
        """Count a loss, and return what explains it; empty if nothing does, or not yet.

        Args:
            silence_ns: how long nothing has come, ns; None: that is not known, and a pause explains
                losses for two timeouts.
            timeout_ns: how long nothing may come, ns.
            now_ns: present time, ns.
            sender: pauses of who was silent, if they can be known.
        """
        self.count += 1
        self._open = None
        if paused := _explaining(self._own, silence_ns, timeout_ns):
            self.without_processor += 1
            self._explain(paused, now_ns)
            return f"this process had no processor for {paused / 1e6:.0f} ms"
        if sender is None or silence_ns is None:
            return ""
        self._open = sender, now_ns - silence_ns, timeout_ns
        return self.explained_now(now_ns)

    def explained_now(self, now_ns: int) -> str:
        """Return what has come to explain the last loss, ns; empty if nothing has."""
        if self._open is None:
            return ""
        sender, received_ns, timeout_ns = self._open
        paused = _explaining(sender, sender.looked_ns - received_ns, timeout_ns)
        if not paused:
            return ""
        self._open = None
        self.sender_paused += 1
        self._explain(paused, now_ns)
        return f"{sender.name} had paused for {paused / 1e6:.0f} ms"

    def figures(self) -> dict[str, str]:
        """Return what diagnostics say."""
        return {
            "losses": str(self.count),
            "lost_without_processor": str(self.without_processor),
        }

    def _explain(self, paused_ns: int, now_ns: int) -> None:
        if said := self._own.remedy.after(paused_ns, self._rate_hz, now_ns):
            self._say(said)


def _explaining(pauses: Pauses, silence_ns: int | None, timeout_ns: int) -> int:
    """Return how long the pauses were, ns, that explain a silence; 0 if none do."""
    within, whole = pauses.within(2 * timeout_ns if silence_ns is None else silence_ns)
    return whole if 2 * within >= (silence_ns or timeout_ns) else 0
