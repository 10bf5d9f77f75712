# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The hand's wrench without a sensor: a momentum observer, from encoders and actuators.

Momentum p = Λ_d v changes by all that acts. What is known of it, actuators u, weight w, viscous
damping b v and friction f, is taken off, and the rest is passed through a low-pass r:

    ṙ = ω (ṗ - u - w + b v + f - r),      ω = 2 π bandwidth

over a period T, with means of the period and the exact step of the low-pass,

    r⁺ = r + (1 - e^(-ω T)) (Λ_d (v⁺ - v) / T - u - w + b (v + v⁺) / 2 + f - r)

(after De Luca and Mattone, "Sensorless robot collision detection and hybrid force/motion control",
ICRA 2005, here for a body in Cartesian space). A constant wrench is found without bias, a sinusoid
of frequency f Hz lags by arctan(f / bandwidth) and half a period. What the model does not know is
taken for the hand: Coulomb friction beyond its compensated share, end stops, an error of the mass.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from hapticmech_ros.arrays import Array


@dataclass(frozen=True, slots=True)
class ForceObserver:
    """Constants of the observer of a device.

    Attributes:
        inertia: (6,) diagonal of Λ_d, kg and kg m^2.
        damping: (6,) b, N s/m and N m s/rad.
        weight: (6,) w, N and N m.
        task: (6,) 1 in directions that the scene has, 0 in others.
        bandwidth: Hz.
        period: T, s.
    """

    inertia: Array
    damping: Array
    weight: Array
    task: Array
    bandwidth: float
    period: float

    @property
    def share(self) -> float:
        """1 - e^(-ω T), of what is behind that a period takes away."""
        return -math.expm1(-2.0 * math.pi * self.bandwidth * self.period)

    def next(
        self, estimate: Array, before: Array, after: Array, actuators: Array, friction: Array
    ) -> Array:
        """Return the estimate (6,) of the wrench on the device a period later, N and N m.

        Args:
            estimate: (6,) r.
            before: (6,) twist v at the period's start, as measured, m/s and rad/s.
            after: (6,) twist v⁺ at its end, as measured.
            actuators: (6,) u, mean over the period.
            friction: (6,) f, against the motion, as far as it is known.
        """
        pushed = self.inertia * (after - before) / self.period - actuators - self.weight
        resisted = self.damping * 0.5 * (before + after) + friction
        return np.asarray(estimate + self.share * (self.task * (pushed + resisted) - estimate))
