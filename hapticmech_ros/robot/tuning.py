# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Gains of a robot that follows, with the rate of its observer, and how they pass to others.

They pass in a straight line. A robot that has swung about its target (:mod:`.swing_watch`) has
slower ones: each time the law has 1/√2 of its rates, and the observer 1/16 of its own at the first
time; from the second on its estimate stays as it is.
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from typing import NamedTuple

from hapticmech_ros.robot.gains import Gains


@dataclass(frozen=True, slots=True)
class Tuning:
    """Gains and the observer's rate.

    Attributes:
        gains: of the law.
        observer_rate: κ, of the observer of disturbances, 1/s; 0: none.
    """

    gains: Gains
    observer_rate: float = 0.0

    def towards(self, other: Tuning, share: float) -> Tuning:
        """Return what is so far from this one to another.

        Args:
            other: where it goes.
            share: 0 to 1.
        """

        def between(before: float, after: float) -> float:
            return before + share * (after - before)

        values = {
            field.name: between(getattr(self.gains, field.name), getattr(other.gains, field.name))
            for field in fields(Gains)
        }
        return Tuning(Gains(**values), between(self.observer_rate, other.observer_rate))

    def slowed(self, swings: int) -> Tuning:
        """Return what a robot that has swung has.

        Args:
            swings: how often.
        """
        if swings == 0:
            return self
        slower = 0.5 ** (0.5 * swings)
        gains = replace(
            self.gains,
            linear_rate=slower * self.gains.linear_rate,
            angular_rate=slower * self.gains.angular_rate,
        )
        return Tuning(gains, self.observer_rate / 16.0 if swings == 1 else 0.0)


class TuningRamp(NamedTuple):
    """From one tuning to another.

    Attributes:
        start: s.
        duration: s.
        old, new: before and after.
    """

    start: float
    duration: float
    old: Tuning
    new: Tuning

    def at(self, time: float) -> Tuning:
        """Return the tuning of a time, s."""
        if self.duration <= 0.0 or time >= self.start + self.duration:
            return self.new
        share = max((time - self.start) / self.duration, 0.0)
        return self.old.towards(self.new, share)
