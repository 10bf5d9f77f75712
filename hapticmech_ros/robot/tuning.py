# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Gains of a robot that follows, with the rate of its observer, and how they pass to others.

They pass in a straight line. A robot that has swung about its target (:mod:`.follower`) has
slower ones: each time the law has 1/√2 of its rates, and the observer 1/16 of its own at the first
time; from the second on its estimate stays as it is.

Rates of the law and of its observer from a loop's delay and from the payload it may not know.

Along a direction in which the robot has ρ times the inertia that the law knows, its loop with
the observer of R6 is, but for a delay θ,

    L(s) = ((2 ω + κ) s² + (ω² + 2 ω κ) s + ω² κ) / (ρ s³)

High up it is (2 ω + κ) / (ρ s). A loop of that kind with a delay θ is as fast as it can be with
good margins at half of 1 / θ (S. Skogestad: Simple analytic rules for model reduction and PID
controller tuning, J. Process Control 13, 2003), which a payload, ρ > 1, only makes slower:

    2 ω + κ = 1 / (2 θ)                                                                      (R8)

Without an observer this is his rule for 1 / s² with a delay. With one the loop has three
integrators and bears no more inertia than Routh's condition allows, ρ < (2 + x)(1 + 2 x) / x with
x = κ / ω. With a gain margin of 3/2 at the largest ratio R that is to be borne, of which the delay
takes a part, and x = 1 at most, where ω² κ is largest,

    (2 + x)(1 + 2 x) / x = 3 R / 2                                                           (R9)

For a payload m at a place with the Jacobian J_p, R = 1 + m λ_max(J_p D⁻¹ J_pᵀ).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, fields, replace
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from hapticmech_ros.arrays import Array
from hapticmech_ros.errors import InvalidInputError
from hapticmech_ros.mechanism.lapack import dtrsm
from hapticmech_ros.robot.law import RobotState
from hapticmech_ros.robot.target import Gains


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


# Of the loop at the largest payload.
GAIN_MARGIN = 1.5


class LoopRates(NamedTuple):
    """Rates of a loop.

    Attributes:
        law: ω, 1/s.
        observer: κ, 1/s; 0 without an observer.
    """

    law: float
    observer: float


def loop_rates(delay: float, inertia_ratio: float = 1.0, observed: bool = True) -> LoopRates:
    """Return ω and κ (R8, R9).

    Args:
        delay: θ, s, from a sample of the joints to the middle of the period in which its torques
            act: one and a half periods where they act a period later.
        inertia_ratio: R, 1 or more.
        observed: whether there is an observer; without one every payload is borne.

    Raises:
        InvalidInputError: a delay that is not positive, or a ratio below 1.
    """
    if not (math.isfinite(delay) and delay > 0.0):
        raise InvalidInputError("delay", delay, "must be a positive number of seconds")
    if not (math.isfinite(inertia_ratio) and inertia_ratio >= 1.0):
        raise InvalidInputError("inertia_ratio", inertia_ratio, "must be a number of 1 or more")
    gain = 0.5 / delay
    if not observed:
        return LoopRates(0.5 * gain, 0.0)
    # 2 x + 2 / x = c has real roots from 4 on, where both are 1.
    c = max(GAIN_MARGIN * inertia_ratio - 5.0, 4.0)
    share = 0.25 * (c - math.sqrt(c**2 - 16.0))
    rate = gain / (2.0 + share)
    return LoopRates(rate, share * rate)


def inertia_ratio(state: RobotState, payload: float, place: Array) -> float:
    """Return R, the most by which a payload multiplies the inertia of any motion at a state.

    Args:
        state: of the robot.
        payload: m, kg.
        place: (3,) where it is, m, from the operational point in its axes.

    Raises:
        InvalidInputError: a payload that is negative or not finite.
    """
    if not (math.isfinite(payload) and payload >= 0.0):
        raise InvalidInputError("payload", payload, "must be a number of 0 or more")
    jacobian, turn = state.point.jacobian, state.point.pose.rotation
    there = jacobian[:3] - pin.skew(turn @ place) @ jacobian[3:]
    moved = dtrsm(1.0, state.factor, there.T, lower=1)
    return 1.0 + payload * float(np.linalg.eigvalsh(moved.T @ moved)[-1])
