# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What goes into the controllers of Fig. 3 and what comes out, in one control period.

As flat arrays they travel between nodes, and controllers read them. A device's sample is laid out
as :class:`~hapticmech_ros.numerics.layout.DeviceSample` (19,), what the analysis and the mechanism
report of a point as :class:`~hapticmech_ros.numerics.layout.OperationalModelSample` (139,). Units
and frames are those of the measurements.

Measured poses are carried on to another time, so that those of different times can be compared:
what the hand did acts on the mechanism some periods later than on a device that corrects commands
by itself. The difference is no drift: it is known, and predicted.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from hapticmech_ros.numerics import Array
from hapticmech_ros.numerics.layout import (
    DeviceSample,
    OperationalModelSample,
    Pose,
)
from hapticmech_ros.numerics.quaternions import place_of
from hapticmech_ros.operational import OperationalAnalysis


@dataclass(frozen=True, slots=True)
class DeviceMeasurement:
    """What the device reports, world axes: pose, twist (6,), hand wrench F_h (6,) on the device."""

    pose: pin.SE3
    twist: Array
    hand_wrench: Array


@dataclass(frozen=True, slots=True)
class PointMeasurement:
    """What the mechanism reports of its operational point, world axes.

    ``contact_wrench`` (6,) F_c is by the environment on the mechanism, at the point.
    """

    pose: pin.SE3
    twist: Array
    contact_wrench: Array


@dataclass(frozen=True, slots=True)
class OperationalModel:
    """What the analysis reports: X, P_c, Π (6, 6 each) and a_0 (6,), world axes at the point."""

    inverse_inertia: Array
    constraint_projector: Array
    wrench_projector: Array
    free_acceleration: Array


@dataclass(frozen=True, slots=True)
class ControlOutput:
    """Wrenches of one control period, world axes, N and N m.

    Attributes:
        device: (6,) servo_cf of the device: on the hand, by the device.
        mechanism: (6,) servo_cf of the operational point: on the mechanism, by the hand.
        impedance, joint_constraint, four_channel: (6,) the three parts of ``device``.
        error: (6,) pose error e, m and rad.
    """

    device: Array
    mechanism: Array
    impedance: Array
    joint_constraint: Array
    four_channel: Array
    error: Array

    def rows(self) -> Array:
        """Return all of it (6, 6), one row each, in this order; N and N m, then m and rad."""
        return np.array(
            (
                self.device,
                self.mechanism,
                self.impedance,
                self.joint_constraint,
                self.four_channel,
                self.error,
            )
        )


def operational_model_of(analysis: OperationalAnalysis) -> OperationalModel:
    """Return the part of an analysis that the controllers use, of a loop without delay."""
    return OperationalModel(
        analysis.inverse_inertia,
        analysis.constraint_projector,
        analysis.wrench_projector,
        analysis.free_acceleration,
    )


def flat_device(measured: DeviceMeasurement) -> Array:
    """Return a device's measurement as a ``layout.DeviceSample`` (19,), SI, world axes."""
    place = pin.SE3ToXYZQUAT(measured.pose)
    return np.concatenate((place, measured.twist, measured.hand_wrench))


def flat_operational_model(model: OperationalModel, point: PointMeasurement) -> Array:
    """Return what the analysis and the mechanism report of a point as numbers (139,), without s."""
    return np.concatenate(
        (
            np.zeros(OperationalModelSample.layout["s"]),
            model.inverse_inertia.ravel(),
            model.constraint_projector.ravel(),
            model.wrench_projector.ravel(),
            model.free_acceleration,
            pin.SE3ToXYZQUAT(point.pose),
            point.twist,
            point.contact_wrench,
        )
    )


def device_of(device: Array) -> DeviceMeasurement:
    """Return the measurement that numbers (19,) stand for, of any length of quaternion but 0.

    Args:
        device: (19,) pose, twist and F_h; m, m/s, rad/s, N and N m, world axes.
    """
    sample = DeviceSample(device)
    return DeviceMeasurement(place_of(Pose(device).values), sample.twist, sample.hand_wrench)


def model_of(operational_model: Array) -> OperationalModel:
    """Return the analysis in numbers (139,).

    Args:
        operational_model: (139,) in SI units; see ``layout.OperationalModelSample``.
    """
    model = OperationalModelSample(operational_model)
    x, projector, balance = (
        model.inverse_inertia,
        model.constraint_projector,
        model.wrench_projector,
    )
    return OperationalModel(x, projector, balance, model.free_acceleration)


def point_of(operational_model: Array) -> PointMeasurement:
    """Return the operational point's measurement in numbers (139,).

    Args:
        operational_model: (139,) in SI units; see ``layout.OperationalModelSample``.
    """
    model = OperationalModelSample(operational_model)
    place = place_of(np.concatenate((model.position, model.quaternion)))
    return PointMeasurement(place, model.twist, model.contact)


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


def predicted_twist(model: OperationalModelSample, in_flight: InFlight) -> Array:
    """Return the twist (6,) of the operational point once what is in flight has acted.

    Nothing is predicted of a mechanism that stands still under it, held by contacts, springs or
    gravity.

    Args:
        model: its twist now, X, a_0, and F_c, which is taken as constant.
        in_flight: what has not acted yet.
    """
    impulse = in_flight.impulse + in_flight.duration * model.contact
    moved = model.inverse_inertia @ impulse
    return np.asarray(model.twist + moved + in_flight.duration * model.free_acceleration)


def point_ahead(
    operational_model: Array, ahead: float, in_flight: InFlight | None = None
) -> PointMeasurement:
    """Return the operational point's measurement as a control law is to see it.

    Its pose is carried on by its twist; once what is in flight has acted, if anything is.

    Args:
        operational_model: (139,) in SI units; see ``layout.OperationalModelSample``.
        ahead: s, from its time to that of the device's measurement.
        in_flight: commands that have not acted yet.
    """
    seen = point_of(operational_model)
    twist = seen.twist
    if in_flight is not None:
        twist = predicted_twist(OperationalModelSample(operational_model), in_flight)
        ahead += in_flight.duration
    return PointMeasurement(carried_on(seen.pose, twist, ahead), twist, seen.contact_wrench)
