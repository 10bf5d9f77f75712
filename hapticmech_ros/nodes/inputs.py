# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Values from messages: their age, their expiry, and their order.

Best-effort readers take messages as they come, and a network may swap them. A command that answers
an older sample than the one obeyed would take the device back in time, with a step of the force. So
overtaken messages are detected. Stamps are compared with each other only, never with a clock.

Joint states are read by the names of joints, and lists of numbers in parameters by place.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Generic, TypeVar

import numpy as np
from sensor_msgs.msg import JointState

from hapticmech_ros.errors import InvalidInputError
from hapticmech_ros.numerics import Array
from hapticmech_ros.numerics.times import NANOSECONDS


def joints_read(message: JointState, names: Sequence[str]) -> tuple[Array, Array] | None:
    """Return positions and rates (n,) of some joints; None if a message has none of them.

    Args:
        message: with joints in any order, others included.
        names: of the joints, in the order that is wanted.

    Raises:
        InvalidInputError: a joint, a position or a rate is missing.
    """
    places = {name: index for index, name in enumerate(message.name)}
    if not places.keys() & set(names):
        return None
    missing = [name for name in names if name not in places]
    if missing:
        raise InvalidInputError("name", list(places), f"must have {missing}")
    at = [places[name] for name in names]
    if len(message.position) <= max(at) or len(message.velocity) <= max(at):
        rule = "must have position and velocity of every joint"
        raise InvalidInputError("joint state", len(message.position), rule)
    position = np.array([message.position[index] for index in at])
    velocity = np.array([message.velocity[index] for index in at])
    return position, velocity


def numbers_in(name: str, text: str) -> Array:
    """Return the numbers (n,) of a parameter's text, with spaces or commas between them.

    Args:
        name: of the parameter.
        text: of it; empty: no numbers.

    Raises:
        InvalidInputError: one is none.
    """
    try:
        found = np.array([float(word) for word in text.replace(",", " ").split()])
    except ValueError:
        raise InvalidInputError(name, text, "must be numbers with spaces between") from None
    if not np.isfinite(found).all():
        raise InvalidInputError(name, text, "must be finite")
    return found


# After so long without a newer one, an older stamp is a sender that began anew: its clock was set,
# or it was replaced.
FORGET_NS = NANOSECONDS // 4


class InOrder:
    """The newest stamp of one stream of messages.

    Attributes:
        overtaken: messages that came after newer ones.
    """

    def __init__(self) -> None:
        self.overtaken = 0
        self._newest_ns = NEVER
        self._arrived_ns = NEVER

    def is_next(self, stamp_ns: int, now_ns: int) -> bool:
        """Return whether a message is no older than those before it, and count it if it is.

        Args:
            stamp_ns: its stamp; one that equals ``now_ns`` had none, and is taken as it comes.
            now_ns: when it arrived.
        """
        if stamp_ns == now_ns:
            return True
        if stamp_ns < self._newest_ns and now_ns - self._arrived_ns <= FORGET_NS:
            self.overtaken += 1
            return False
        self._newest_ns, self._arrived_ns = stamp_ns, now_ns
        return True

    @property
    def last(self) -> tuple[int, int]:
        """The newest stamp, and when it arrived, ns."""
        return self._newest_ns, self._arrived_ns

    @last.setter
    def last(self, stamps: tuple[int, int]) -> None:
        self._newest_ns, self._arrived_ns = stamps

    def forget(self) -> None:
        """Take the next message as the newest."""
        self._newest_ns = self._arrived_ns = NEVER


T = TypeVar("T")
NEVER = -(1 << 62)


@dataclass(slots=True)
class Latest(Generic[T]):
    """The last accepted value of an input, and its time (ns of the node's clock)."""

    value: T | None = None
    stamp_ns: int = NEVER

    def put(self, value: T, stamp_ns: int) -> None:
        """Keep a new value."""
        self.value = value
        self.stamp_ns = stamp_ns

    def renew(self, stamp_ns: int) -> None:
        """Set another time of the present value, if there is one."""
        if self.value is not None:
            self.stamp_ns = stamp_ns

    def fresh(self, now_ns: int, timeout_ns: int) -> bool:
        """Return whether there is a value no older than ``timeout_ns``."""
        return now_ns - self.stamp_ns <= timeout_ns


@dataclass(slots=True)
class Standing(Latest[T]):
    """A command, and the one before it that stood at the last sample.

    Over a period the command known at its start acts. Samples that are caught up after a stall
    precede messages received after it: for them, too, the command of their time counts, which may
    have expired meanwhile.
    """

    before: T | None = None
    before_ns: int = NEVER

    def sampled(self) -> None:
        """Note that a sample was taken under the present value."""
        self.before, self.before_ns = self.value, self.stamp_ns

    def lapsed(self, now_ns: int, timeout_ns: int) -> bool:
        """Return whether the last sample's value has expired by now, and forget it then.

        A process that stood still for so long has missed the end of it.
        """
        if self.before is None or now_ns - self.before_ns <= timeout_ns:
            return False
        self.before, self.before_ns = None, NEVER
        return True

    def as_of(self, time_ns: int) -> tuple[T | None, int]:
        """Return the value known at a time, and since when, ns."""
        if self.stamp_ns > time_ns:
            return self.before, self.before_ns
        return self.value, self.stamp_ns

    def clear(self) -> None:
        """Forget all."""
        self.value = self.before = None
        self.stamp_ns = self.before_ns = NEVER


@dataclass(slots=True)
class ExpiringWrench(Standing[Array]):
    """A wrench command (6,), N and N m, that is ramped to zero when it is not renewed.

    Attributes:
        timeout_ns: how long a command stands; 0 keeps it for ever.
        ramp_ns: how long it then takes to reach zero.
    """

    timeout_ns: int = 0
    ramp_ns: int = 0

    def put_into(self, wrenches: Array) -> tuple[int, int]:
        """Fill (2, 6) with the present command, and that of the last sample.

        Args:
            wrenches: (2, 6) to fill, N and N m, in the axes given.

        Returns:
            Since when each does, ns.
        """
        for row, wrench in zip(wrenches, (self.value, self.before), strict=True):
            row[:] = 0.0 if wrench is None else wrench
        return self.stamp_ns, self.before_ns

    def take_from(self, wrenches: Array, received_ns: int, before_ns: int) -> None:
        """Take a kernel's changes of the values of :meth:`put_into`.

        Args:
            wrenches: (2, 6) likewise.
            received_ns: since when the first one stands.
            before_ns: the second.
        """
        stands, stood = wrenches.copy()
        self.value, self.stamp_ns = (None if received_ns == NEVER else stands), received_ns
        self.before, self.before_ns = (None if before_ns == NEVER else stood), before_ns

    def received(self, now_ns: int) -> bool:
        """Return whether a command came within the timeout."""
        return self.fresh(now_ns, self.timeout_ns)

    def stands(self, now_ns: int) -> bool:
        """Return whether a command still acts at ``now_ns``."""
        if self.value is None:
            return False
        return self.timeout_ns == 0 or self.fresh(now_ns, self.timeout_ns + self.ramp_ns)

    def at(self, now_ns: int) -> Array:
        """Return the wrench (6,) that stands at ``now_ns``, N and N m, in the axes given."""
        wrench, received_ns = self.as_of(now_ns)
        if wrench is None:
            return np.zeros(6)
        if self.timeout_ns == 0:
            return wrench
        over = now_ns - received_ns - self.timeout_ns
        if over <= 0:
            return wrench
        if over >= self.ramp_ns:
            return np.zeros(6)
        return np.asarray(wrench * (1.0 - over / self.ramp_ns))


# Over so long, and the span before it: clocks drift by microseconds meanwhile.
SPAN_NS = 10 * NANOSECONDS


class SampleAge:
    """Judges samples of a device, in order, without comparing two hosts' clocks.

    The time of arrival less a stamp is the transit time plus the difference of the two clocks. The
    recent minimum is the quickest transit with the same difference: a sample's excess over it is
    its additional delay.
    """

    def __init__(self) -> None:
        self.forget()

    def forget(self) -> None:
        """Begin anew: the sender's clock may be another one."""
        self._least_ns: int | None = None
        self._next_ns: int | None = None
        self._since_ns = self._stamp_ns = NEVER

    def check(self, stamp_ns: int, limit_ns: int) -> None:
        """Refuse a sample that is too old.

        Args:
            stamp_ns: of the sample; one before the last means that the sender's clock was set.
            limit_ns: how old it may be.

        Raises:
            InvalidInputError: it is older.
        """
        beyond_ns = self.beyond(stamp_ns)
        if beyond_ns > limit_ns:
            rule = f"must be within {limit_ns / NANOSECONDS:g} s of the quickest one's"
            raise InvalidInputError("age of sample, s", beyond_ns / NANOSECONDS, rule)

    def beyond(self, stamp_ns: int) -> int:
        """Return by how much longer, ns, a sample that comes now took than the quickest one.

        Args:
            stamp_ns: of the sample; one before the last means that the sender's clock was set.
        """
        if stamp_ns < self._stamp_ns:
            self.forget()
        self._stamp_ns = stamp_ns
        # Any clock works that is never set.
        arrived_ns = time.monotonic_ns()
        lacks = arrived_ns - stamp_ns
        if self._next_ns is None or arrived_ns - self._since_ns > SPAN_NS:
            self._least_ns, self._next_ns, self._since_ns = self._next_ns, lacks, arrived_ns
        self._next_ns = min(self._next_ns, lacks)
        least = self._next_ns if self._least_ns is None else min(self._least_ns, self._next_ns)
        return lacks - least
