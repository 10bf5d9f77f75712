# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Carries a measured pose on to another time, so that poses of different times can be compared.

What the hand did acts on the mechanism some periods later than on a device that corrects commands
by itself. The difference is no drift: it is known, and predicted.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pinocchio as pin

from hapticmech_ros.arrays import Array
from hapticmech_ros.control.flat import model_of, point_of
from hapticmech_ros.control.measurements import PointMeasurement


class InFlight(NamedTuple):
    """Commands to the mechanism that have not acted yet, and half of the one that is made now.

    The mechanism gets a hand's wrench of the samples, held over a period: half a period later, in
    the mean, than the device on which it acts.

    Attributes:
        duration: s, for which they will act, one after the other.
        impulse: (6,) what they will have done then, N s and N m s, world axes.
    """

    duration: float
    impulse: Array


def carried_on(pose: pin.SE3, twist: Array, duration: float) -> pin.SE3:
    """Return where a frame with constant twist is after ``duration`` (s, may be negative).

    Args:
        pose: of the frame in the world.
        twist: (6,) of its origin, world axes, m/s and rad/s.
        duration: s.
    """
    turn = np.asarray(pin.exp3(duration * twist[3:]))
    return pin.SE3(turn @ pose.rotation, pose.translation + duration * twist[:3])


def predicted_twist(
    twist: Array,
    inverse_inertia: Array,
    free_acceleration: Array,
    contact_wrench: Array,
    in_flight: InFlight,
) -> Array:
    """Return the twist (6,) of the operational point once what is in flight has acted.

    Nothing is predicted of a mechanism that stands still under it, held by contacts, springs or
    gravity.

    Args:
        twist: (6,) now, m/s and rad/s, world axes.
        inverse_inertia: (6, 6) X, 1/kg, 1/(kg m) and 1/(kg m²), world axes at the point.
        free_acceleration: (6,) a_0, m/s² and rad/s², world axes at the point.
        contact_wrench: (6,) F_c, N and N m, taken as constant.
        in_flight: what has not acted yet.
    """
    impulse = in_flight.impulse + in_flight.duration * contact_wrench
    return np.asarray(twist + inverse_inertia @ impulse + in_flight.duration * free_acceleration)


def point_ahead(
    operational_model: Array, ahead: float, in_flight: InFlight | None = None
) -> PointMeasurement:
    """Return the operational point's measurement as a control law is to see it.

    Its pose is carried on by its twist; once what is in flight has acted, if anything is.

    Args:
        operational_model: (139,) in SI units; see ``layout.OPERATIONAL_MODEL``.
        ahead: s, from its time to that of the device's measurement.
        in_flight: commands that have not acted yet.
    """
    seen, model = point_of(operational_model), model_of(operational_model)
    twist, contact = seen.twist, seen.contact_wrench
    if in_flight is not None:
        x, free = model.inverse_inertia, model.free_acceleration
        twist = predicted_twist(twist, x, free, contact, in_flight)
        ahead += in_flight.duration
    return PointMeasurement(carried_on(seen.pose, twist, ahead), twist, contact)
