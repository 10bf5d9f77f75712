"""Engagement (clutch): ties the device's pose to the operational point's when rendering starts.

A device wakes up anywhere in its workspace. The offset between the two poses at the moment of
engagement is kept, axes of the world shared, so that rendering starts without error and without a
jump; it starts anew after every interruption.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from hapticmech_ros.mechanism.model import Array


@dataclass(frozen=True, slots=True)
class Engagement:
    """The tie between the device's pose and the operational point's.

    Attributes:
        time: s, when rendering started.
        displacement: (3,) m, from device to operational point at that time.
        turn: (3, 3) rotation, R_device R_turn = R_point at that time.
    """

    time: float
    displacement: Array
    turn: Array

    def mapped(self, device: pin.SE3) -> pin.SE3:
        """Return the device's pose seen from the mechanism's side."""
        return pin.SE3(device.rotation @ self.turn, device.translation + self.displacement)

    def ramp(self, time: float, duration: float) -> float:
        """Return the share of the wrench that is let through at ``time``: 0 to 1."""
        if duration <= 0.0:
            return 1.0
        return float(np.clip((time - self.time) / duration, 0.0, 1.0))


def engage(time: float, device: pin.SE3, point: pin.SE3) -> Engagement:
    """Return the engagement that maps the device's pose onto the operational point's."""
    return Engagement(
        time,
        point.translation - device.translation,
        device.rotation.T @ point.rotation,
    )


def pose_error(point: pin.SE3, device: pin.SE3) -> Array:
    """Return e (6,) = log(point⁻¹ device), a twist in world axes at the point; m and rad."""
    body = pin.log6(point.actInv(device)).vector
    rotation = point.rotation
    return np.concatenate((rotation @ body[:3], rotation @ body[3:]))
