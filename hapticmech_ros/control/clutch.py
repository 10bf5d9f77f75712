"""The clutch between the device and the operational point, as in teleoperation.

A device may be anywhere in its workspace when rendering starts. The clutch offset is the pose of
the operational point relative to the device at that moment, axes of the world shared. It is kept,
so that rendering starts without an error of position and without a step of force, and it is
computed anew after every interruption.

When the operational point is put elsewhere, the clutch is engaged anew while the device moves and
pushes. The wrench of that moment is carried on and fades as the new one comes in, and the clutch
slips while it closes: only the cube of the ramp's share of the difference in velocity becomes an
error of position, so that damping brings both to one velocity before the springs act.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
import pinocchio as pin

from hapticmech_ros.arrays import Array


@dataclass(frozen=True, slots=True)
class Clutch:
    """A clutch: the offset between the device's pose and the operational point's.

    Attributes:
        time: s, when rendering started; -inf once the clutch has slipped and is closed.
        displacement: (3,) m, from device to operational point at that time.
        turn: (3, 3) rotation, R_device R_turn = R_point at that time.
        carried: (6,) wrench of the device at that time, N and N m, world axes, which fades as the
            ramp rises; None when the device was left alone before.
        slipped_until: s, until when the offset has slipped; of a clutch with ``carried``.
    """

    time: float
    displacement: Array
    turn: Array
    carried: Array | None = None
    slipped_until: float = 0.0

    def mapped(self, device: pin.SE3) -> pin.SE3:
        """Return the device's pose seen from the mechanism's side."""
        return pin.SE3(device.rotation @ self.turn, device.translation + self.displacement)

    def ramp(self, time: float, duration: float) -> float:
        """Return the share of the wrench that is let through at ``time``: 0 to 1."""
        if duration <= 0.0:
            return 1.0
        return float(np.clip((time - self.time) / duration, 0.0, 1.0))

    def faded(self, time: float, duration: float) -> Array | None:
        """Return what is left (6,) of ``carried`` at ``time`` (s), N and N m; None for nothing."""
        return None if self.carried is None else (1.0 - self.ramp(time, duration)) * self.carried

    def with_slip(
        self, time: float, duration: float, device: pin.SE3, device_twist: Array, twist: Array
    ) -> Clutch:
        """Return the clutch with its offset slipped until ``time``; itself, once it is closed.

        Args:
            time: s.
            duration: of the ramp, s.
            device: pose of the device.
            device_twist: (6,) of the device, m/s and rad/s, world axes.
            twist: (6,) of the operational point, m/s and rad/s, world axes.
        """
        if self.carried is None:
            return self
        share = self.ramp(time, duration)
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


def engage(time: float, device: pin.SE3, point: pin.SE3, carried: Array | None = None) -> Clutch:
    """Return the clutch that maps the device's pose onto the operational point's.

    Args:
        time: s.
        device: its pose at that time.
        point: that of the operational point.
        carried: (6,) the device's wrench until then, if it held the mechanism elsewhere; N and N m,
            world axes.
    """
    return Clutch(
        time,
        point.translation - device.translation,
        device.rotation.T @ point.rotation,
        carried,
        time,
    )


def pose_error(point: pin.SE3, device: pin.SE3) -> Array:
    """Return e (6,) = log(point⁻¹ device), a twist in world axes at the point; m and rad."""
    body = pin.log6(point.actInv(device)).vector
    rotation = point.rotation
    return np.concatenate((rotation @ body[:3], rotation @ body[3:]))
