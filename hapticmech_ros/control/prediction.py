"""Carries a measured pose on to another time, so that poses of different clocks can be compared."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from hapticmech_ros.mechanism.model import Array


def carried_on(pose: pin.SE3, twist: Array, duration: float) -> pin.SE3:
    """Return where a frame with constant twist is after ``duration`` (s, may be negative).

    Args:
        pose: of the frame in the world.
        twist: (6,) of its origin, world axes, m/s and rad/s.
        duration: s.
    """
    turn = np.asarray(pin.exp3(duration * twist[3:]))
    return pin.SE3(turn @ pose.rotation, pose.translation + duration * twist[:3])
