# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A device that is swung: its samples in closed form."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from hapticmech_ros.numerics.layout import DeviceSample

POSITION, QUATERNION, TWIST = (
    DeviceSample.layout.slice(name) for name in ("position", "quaternion", "twist")
)
AXES = np.eye(3)


@dataclass(frozen=True)
class Swing:
    """A hand that moves by several sines in all six directions, in closed form."""

    size: np.ndarray
    rate: np.ndarray
    phase: np.ndarray

    @classmethod
    def random(cls, seed: int, planar: bool = False) -> Swing:
        """Return one of up to 0.6 m/s and 12 rad/s, with up to 5 Hz; planar: x, y and about z."""
        rng = np.random.default_rng(seed)
        rate = 2.0 * math.pi * rng.uniform(0.2, 5.0, 6)
        fastest = np.array([0.35] * 3 + [7.0] * 3) * rng.uniform(0.05, 1.0)
        if planar:
            fastest[2:5] = 0.0
        return cls(fastest / rate, rate, rng.uniform(0.0, 2.0 * math.pi, 6))

    def sample(self, time: float) -> np.ndarray:
        """Return the sample (19,) at a time, s."""
        place = self.size * np.sin(self.rate * time + self.phase)
        speed = self.size * self.rate * np.cos(self.rate * time + self.phase)
        found = np.zeros(DeviceSample.layout.size)
        found[POSITION] = place[:3]
        # Rotations about x, then y, then z of the world, and their angular velocity.
        x, y, z = (
            Rotation.from_rotvec(angle * axis) for angle, axis in zip(place[3:], AXES, strict=True)
        )
        found[QUATERNION] = (z * y * x).as_quat()
        spin = speed[5] * AXES[2] + z.apply(speed[4] * AXES[1] + y.apply(speed[3] * AXES[0]))
        found[TWIST] = np.concatenate((speed[:3], spin))
        return found
