# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The clutch between the device and the operational point, as in teleoperation.

A device may be anywhere in its workspace when rendering starts. The clutch offset is the pose of
the operational point relative to the device at that moment, axes of the world shared. Rendering
keeps it, and so starts without a position error; it is recomputed after every interruption.

At a start the force channel acts at once, F_h on the mechanism and the device's answer to it:
wrenches that follow measured forces start without a bump, and with both sides accelerating alike no
spring is needed to keep them together. In Λ_d (X F_h + ẍ_0) - F_h + r (1 - β) Π F_h the joints
balance the hand's whole push along their constraints until their spring carries it. A hand that
presses against a joint constraint while rendering is interrupted would otherwise be let go, and be
caught with twice its force by a spring that it loads suddenly.

In the first half of the ramp dampers bring both sides to one velocity. With the push balanced they
act on the device's own inertia m: the share min(1, 1.2 m / (b t)) of a damper b, with t s left,
brakes by 1.2 m v / t, little more than is needed. A moving device gets a longer ramp, which keeps
this below ``engagement_force``. In the second half springs come in, with a share r that rises from
0 to 1. Until then the clutch slips: only r³ of the difference in velocity becomes an error of
position.

After the operational point is moved, the wrench of that moment fades with share 1 - r, while the
new place's wrenches come in over the whole ramp.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
import pinocchio as pin

from hapticmech_ros.control.loop_layout import BRAKE
from hapticmech_ros.device import NO_WRENCH
from hapticmech_ros.numerics import Array
from hapticmech_ros.numerics.quaternions import turned


@dataclass(frozen=True, slots=True)
class Clutch:
    """A clutch: the offset between the device's pose and the operational point's.

    Attributes:
        time: s, when it was engaged; -inf once it is closed and slips no more.
        displacement: (3,) m, from device to operational point at that time.
        turn: (3, 3) rotation, R_device R_turn = R_point at that time.
        duration: s, of the ramp.
        carried: (6,) wrench of the device at that time, N and N m, world axes, which fades as the
            ramp rises; None if it held no other place.
        slipped_until: s, until when the offset has slipped.
    """

    time: float
    displacement: Array
    turn: Array
    duration: float = 0.0
    carried: Array | None = None
    slipped_until: float = 0.0

    @property
    def is_closing(self) -> bool:
        """Whether it slips."""
        return self.time > -math.inf

    def mapped(self, device: pin.SE3) -> pin.SE3:
        """Return the device's pose seen from the mechanism's side."""
        return pin.SE3(device.rotation @ self.turn, device.translation + self.displacement)

    def ramp(self, time: float) -> float:
        """Return the share r of springs that is let through at ``time`` (s): 0 to 1."""
        if self.duration <= 0.0:
            return 1.0
        begun = 0.0 if self.carried is not None else 0.5
        return float(
            np.clip(((time - self.time) / self.duration - begun) / (1.0 - begun), 0.0, 1.0)
        )

    def faded(self, time: float) -> Array:
        """Return the rest (6,) of ``carried`` at ``time`` (s), N and N m; zero for nothing."""
        return NO_WRENCH if self.carried is None else (1.0 - self.ramp(time)) * self.carried

    def brake(self, time: float, rate: float) -> float:
        """Return the share 0 to 1 of a damper that is let through at ``time`` (s).

        Args:
            time: s.
            rate: b / m, 1/s, of the damper on the device's inertia.
        """
        if self.carried is not None:
            return self.ramp(time)
        left = self.time + 0.5 * self.duration - time
        return 1.0 if left <= 0.0 or rate * left <= BRAKE else BRAKE / (rate * left)

    def force_ramp(self, time: float) -> float:
        """Return the share of the force channel that is let through at ``time`` (s): 0 to 1."""
        return 1.0 if self.carried is None else self.ramp(time)

    def with_slip(self, time: float, device: pin.SE3, device_twist: Array, twist: Array) -> Clutch:
        """Return the clutch with its offset slipped until ``time``; itself, once it is closed.

        Args:
            time: s.
            device: pose of the device.
            device_twist: (6,) of the device, m/s and rad/s, world axes.
            twist: (6,) of the operational point, m/s and rad/s, world axes.
        """
        if not self.is_closing:
            return self
        share = self.ramp(time)
        if share >= 1.0:
            return replace(self, carried=None, time=-math.inf)
        away = (1.0 - share**3) * (time - self.slipped_until) * (twist - device_twist)
        rotation = device.rotation
        return replace(
            self,
            displacement=self.displacement + away[:3],
            turn=rotation.T @ pin.exp3(away[3:]) @ rotation @ self.turn,
            slipped_until=time,
        )


def engage(
    time: float,
    device: pin.SE3,
    point: pin.SE3,
    duration: float = 0.0,
    carried: Array | None = None,
) -> Clutch:
    """Return the clutch that maps the device's pose onto the operational point's.

    Args:
        time: s.
        device: its pose at that time.
        point: that of the operational point.
        duration: s, of the ramp; 0 lets all through at once.
        carried: (6,) the device's wrench until then, if it held the mechanism elsewhere; N and N m,
            world axes.
    """
    return Clutch(
        time,
        point.translation - device.translation,
        device.rotation.T @ point.rotation,
        duration,
        carried,
        time,
    )


def pose_error(point: pin.SE3, device: pin.SE3) -> Array:
    """Return e (6,) = log(point⁻¹ device), a twist in world axes at the point; m and rad."""
    body = pin.log6(point.actInv(device)).vector
    return turned(body, point.rotation)
