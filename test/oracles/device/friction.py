# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What resists a device's motion besides viscous damping: end stops, then Coulomb friction.

Both are implicit in the speed at the end of a step h, so that neither adds energy at any stiffness
or friction; g = h / m, or h / I of rotation.

End stop, along the way out n, where d is the distance beyond the limit with a time t of the step
left: the force f = k (d + t v⁺) + b v⁺, if positive, gives

    v⁺ = (v - g k d) / (1 + g (b + t k))

and has no damper where the speed turns round in the step.

Coulomb friction takes up to g F_c of the speed, never more than there is:

    v⁺ = max(1 - g F_c / |v|, 0) v
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from hapticmech_ros.arrays import Array
from hapticmech_ros.scene.device import Device


@dataclass(frozen=True, slots=True)
class EndStop:
    """A limit and the spring and damper beyond it.

    Attributes:
        limit: m or rad, of the distance; 0 for none.
        stiffness: N/m or N m/rad.
        damping: N s/m or N m s/rad.
    """

    limit: float
    stiffness: float
    damping: float

    def stopped(self, away: Array, rate: Array, gain: float, left: float) -> Array:
        """Return the rate (3,) after a step.

        Args:
            away: (3,) from where the device started.
            rate: (3,) of ``away``, with all other forces of the step in it.
            gain: change of the rate per force or torque in a step.
            left: s, of the step.
        """
        distance = math.sqrt(away @ away)
        if self.limit == 0.0 or distance == 0.0:
            return rate
        beyond = distance - self.limit
        out = away / distance
        speed = float(out @ rate)
        if beyond + left * speed <= 0.0:
            return rate
        pushed = speed - gain * self.stiffness * beyond
        resistance = left * self.stiffness + (self.damping if pushed * speed >= 0.0 else 0.0)
        after = pushed / (1.0 + gain * resistance)
        return np.asarray(rate + (after - speed) * out) if after < speed else rate


def rubbed(rate: Array, most: float) -> Array:
    """Return a rate (3,) after friction took ``most`` of it, or all."""
    speed = math.sqrt(rate @ rate)
    return np.zeros(3) if speed <= most else np.asarray((1.0 - most / speed) * rate)


class Friction:
    """End stops and friction of a device.

    Args:
        device: of the scene.
        left: s, of a step, when they act.

    Attributes:
        stops: of translation and of rotation.
        friction: N and N m.
        some: whether there is any of it.
    """

    def __init__(self, device: Device, left: float) -> None:
        space = device.workspace
        self.stops = (
            EndStop(space.radius, space.stiffness, space.damping),
            EndStop(space.angle, space.angular_stiffness, space.angular_damping),
        )
        self.friction = (device.coulomb_friction, device.angular_coulomb_friction)
        self.some = any(self.friction) or any(stop.limit for stop in self.stops)
        self._left = left

    def resisted(self, home: pin.SE3, pose: pin.SE3, twist: Array, gain: Array) -> Array:
        """Return the twist (6,) at the end of a step.

        Args:
            home: pose about which the workspace is.
            pose: at the start of the step.
            twist: (6,) at its end, if nothing resisted.
            gain: (6,) change of the twist per wrench in a step.
        """
        if not self.some:
            return twist
        # A planar device has no gain along z, nor about x and y.
        linear, angular = gain[0], gain[5]
        away = pose.translation - home.translation
        rate = self.stops[0].stopped(away, twist[:3], linear, self._left)
        turn = pin.log3(pose.rotation @ home.rotation.T)
        spin = self.stops[1].stopped(turn, twist[3:], angular, self._left)
        rate = rubbed(rate, linear * self.friction[0]) if self.friction[0] else rate
        spin = rubbed(spin, angular * self.friction[1]) if self.friction[1] else spin
        return np.concatenate((rate, spin))
