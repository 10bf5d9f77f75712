# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Timeouts of the control loop, in periods: the margin is the same at each rate. No ROS.

Inputs come once a period. A time that suits 1 kHz is a few periods of a slow loop, and a machine's
shortest pause would end it.

It also counts an actor's losses of late inputs, and whether a pause explains them: if pauses make
up half of the silence.

Pauses are found by a process's own clocks, and from a sender's messages. A process that wanted to
wait until a deadline at the longest, and went on later, without having computed meanwhile, had no
processor: others had them all, or it was stopped. A sender's messages show that it paused, but not
why.
"""

from __future__ import annotations

import math
import time
from collections import deque
from collections.abc import Callable, Sequence
from typing import NamedTuple, Protocol

from hapticmech_ros.errors import InvalidInputError
from hapticmech_ros.nodes.inputs import NEVER
from hapticmech_ros.nodes.lane_kernels import SHORTEST_PAUSE_NS
from hapticmech_ros.nodes.sources import Origin
from hapticmech_ros.numerics.times import NANOSECONDS
from hapticmech_ros.scene.device import Device

_REMEMBERED = 16
MINUTE_NS = 60 * NANOSECONDS
# So many losses within a minute that pauses explain are no accident: the machine is too slow.
SEVERAL = 3


class Pauses:
    """Pauses of a process.

    Attributes:
        looked_ns: time of the last check, ns.
    """

    def __init__(self) -> None:
        self.looked_ns = NEVER
        self._found: deque[tuple[int, int]] = deque(maxlen=_REMEMBERED)

    def within(self, time_ns: int) -> tuple[int, int]:
        """Return how long it paused, ns, within a time up to the last look, ns.

        Returns:
            As far as that lies within, and how long these pauses were as a whole.
        """
        start = self.looked_ns - time_ns
        found = [(length, end - start) for end, length in self._found if end > start]
        return sum(map(min, found)), sum(length for length, _ in found)

    def _note(self, end_ns: int, length_ns: int) -> None:
        """Note a pause up to a time, ns."""
        if length_ns > SHORTEST_PAUSE_NS:
            self._found.append((end_ns, length_ns))


class Remedy:
    """Advises where pauses are no accident; once a minute in a process."""

    def __init__(self) -> None:
        self._lately: deque[tuple[int, int]] = deque(maxlen=1000)
        self._logged_ns: int | None = None

    def after(self, length_ns: int, rate_hz: float, now_ns: int) -> str:
        """Return advice after a loss that a pause explains; mostly empty.

        Args:
            length_ns: of the pause, ns.
            rate_hz: the control rate, Hz.
            now_ns: present time, ns.
        """
        lately = self._lately
        lately.append((now_ns, length_ns))
        while now_ns - lately[0][0] > MINUTE_NS:
            lately.popleft()
        logged_ns = self._logged_ns
        if len(lately) < SEVERAL or (logged_ns is not None and now_ns - logged_ns < MINUTE_NS):
            return ""
        self._logged_ns = now_ns
        longest_ms = max(length for _, length in lately) / 1e6
        return (
            f"rendering ended {len(lately)} times within a minute because a process paused, for up "
            f"to {longest_ms:.0f} ms: this machine cannot keep this rate ({rate_hz:g} Hz): "
            "see docs/realtime.md"
        )


class OwnPauses(Pauses):
    """Those of this process, in which a node's loop wanted to go on and had no processor.

    Args:
        wait_ns: returns how long the node would still wait now, ns, negative if it wanted to go on
            before; None: for ever.
        clock_ns: returns the time, ns.
        computed_ns: returns for how long this process has computed, ns.

    Attributes:
        remedy: advises.
    """

    def __init__(
        self,
        wait_ns: Callable[[], int | None],
        clock_ns: Callable[[], int] = time.monotonic_ns,
        computed_ns: Callable[[], int] = time.process_time_ns,
    ) -> None:
        super().__init__()
        self.remedy = Remedy()
        self._wait_ns, self._clock_ns, self._computed_ns = wait_ns, clock_ns, computed_ns
        self._computed = 0

    def look(self) -> None:
        """Note that the process goes on; called before every message and deadline."""
        before, computed = self.looked_ns, self._computed
        self.looked_ns = now = self._clock_ns()
        self._computed = self._computed_ns()
        if before == NEVER or now - before <= SHORTEST_PAUSE_NS:
            return
        wait_ns = self._wait_ns()
        if wait_ns is not None:
            wanted = min(now - before, -wait_ns)
            self._note(now, wanted - (self._computed - computed))

    def paused(self, end_ns: int, length_ns: int) -> None:
        """Note a pause that a kernel has noticed: when it ended, and its length, ns."""
        self.looked_ns, self._computed = self._clock_ns(), self._computed_ns()
        self._note(end_ns, length_ns)


class SenderPauses(Pauses):
    """Those of a sender of stamps on a grid of periods: stamps that go on faster than their count.

    Args:
        name: of the sender, in words.
        period_ns: of its messages.
    """

    def __init__(self, name: str, period_ns: int) -> None:
        super().__init__()
        self.name = name
        self._period_ns = period_ns
        self._via = self._count = self._stamp_ns = 0

    @property
    def last(self) -> tuple[int, int, int]:
        """Of the last message its publisher, its number, and its stamp, ns."""
        return self._via, self._count, self._stamp_ns

    def received(self, stamp_ns: int, origin: Origin, now_ns: int) -> None:
        """Note a message.

        Args:
            stamp_ns: its stamp, ns.
            origin: its publisher and number.
            now_ns: time of its arrival, ns.
        """
        count = origin.sent or origin.number
        periods = count - self._count
        before_ns, anew = self._stamp_ns, origin.via != self._via
        self.went_on(stamp_ns, origin, now_ns)
        if count and periods > 0 and not anew:
            self._note(now_ns, stamp_ns - before_ns - periods * self._period_ns)

    def went_on(
        self, stamp_ns: int, origin: Origin, now_ns: int, pauses: Sequence[Sequence[int]] = ()
    ) -> None:
        """Note the last of several messages, and the pauses between them.

        Args:
            stamp_ns: of the last message, ns.
            origin: its publisher and number.
            now_ns: time of its arrival, ns.
            pauses: when each ended, by its stamps, and its length, ns.
        """
        self.looked_ns = now_ns
        self._via, self._count = origin.via, origin.sent or origin.number
        self._stamp_ns = stamp_ns
        for end_ns, length_ns in pauses:
            self._note(end_ns, length_ns)


# A periodic message is sometimes late by a period, and sometimes lost: a timeout shorter than so
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


# How long a device acts on a command.
COMMAND = ByRate(12, 0.012)
# How long a controller acts on its inputs: the device has its zero command a period later.
CONTROLLER_INPUT = ByRate(11, 0.011)
# How long the mechanism acts on a command, and takes to ramp it to zero afterwards.
MECHANISM_COMMAND = ByRate(50, 0.05)
# Of the robot that follows: samples of its joints, of its target, and of its wrench sensor.
ROBOT_JOINTS, ROBOT_TARGET, ROBOT_WRENCH = ByRate(12, 0.02), ByRate(12, 0.05), ByRate(12, 0.05)
# Within this the device is without force after any node has died, or commands have ended.
ZERO_FORCE = ByRate(20, 0.02)


# Python takes over from a compiled function after this share of an input's timeout: what it has not
# done for long takes it milliseconds the first time, which would be added to the timeout.
_PLAIN_SHARE = 0.75


def plain_timeout_ns(timeout_ns: int) -> int:
    """Return the longest silence of an input, ns, that a compiled function bears."""
    return round(_PLAIN_SHARE * timeout_ns)


class HasLockstep(Protocol):
    """The parameter of a node that disables timeouts."""

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
    """Counts an actor's losses, and explains them.

    Args:
        own: pauses of this process.
        rate_hz: the control rate, Hz.
        log: warns.

    Attributes:
        count: losses.
        without_processor: of these, those that a pause of this process explains.
        sender_paused: those that a pause of the sender explains.
    """

    def __init__(self, own: OwnPauses, rate_hz: float, log: Callable[[str], None]) -> None:
        self._own, self._rate_hz, self._log = own, rate_hz, log
        self.count = self.without_processor = self.sender_paused = 0
        # A loss not explained yet: the silent sender, since when, and the timeout.
        self._open: tuple[SenderPauses, int, int] | None = None

    def explained(
        self,
        silence_ns: int | None,
        timeout_ns: int,
        now_ns: int,
        sender: SenderPauses | None = None,
    ) -> str:
        """Count a loss, and return its explanation; empty if none, or none yet.

        Args:
            silence_ns: time without a message, ns; None: not known, and a pause explains losses for
                two timeouts.
            timeout_ns: longest time without a message, ns.
            now_ns: present time, ns.
            sender: pauses of the silent sender, if they can be known.
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
        """Return a later explanation of the last loss, ns; empty if there is none."""
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
        """Return entries for diagnostics."""
        return {
            "losses": str(self.count),
            "lost_without_processor": str(self.without_processor),
        }

    def _explain(self, paused_ns: int, now_ns: int) -> None:
        if logged_ns := self._own.remedy.after(paused_ns, self._rate_hz, now_ns):
            self._log(logged_ns)


def _explaining(pauses: Pauses, silence_ns: int | None, timeout_ns: int) -> int:
    """Return how long the pauses were, ns, that explain a silence; 0 if none do."""
    within, whole = pauses.within(2 * timeout_ns if silence_ns is None else silence_ns)
    return whole if 2 * within >= (silence_ns or timeout_ns) else 0
