# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Measurements as flat arrays: what travels between nodes, and what controllers read.

A device's sample is laid out as :data:`~hapticmech_ros.layout.DEVICE_SAMPLE` (19,), what the
analysis and the mechanism report of a point as :data:`~hapticmech_ros.layout.OPERATIONAL_MODEL`
(139,). Units and frames are those of the measurements.
"""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from hapticmech_ros.arrays import Array
from hapticmech_ros.control.measurements import (
    DeviceMeasurement,
    OperationalModel,
    PointMeasurement,
)
from hapticmech_ros.layout import DEVICE_SAMPLE, OPERATIONAL_MODEL

_PLACE = DEVICE_SAMPLE.slice("position", "quaternion")
_TWIST, _FORCE = DEVICE_SAMPLE.slice("twist"), DEVICE_SAMPLE.slice("hand_wrench")
_MATRICES = OPERATIONAL_MODEL.slice("inverse_inertia", "wrench_projector")
_FREE = OPERATIONAL_MODEL.slice("free_acceleration")
_POINT_PLACE = OPERATIONAL_MODEL.slice("position", "quaternion")
_POINT_TWIST, _CONTACT = OPERATIONAL_MODEL.slice("twist"), OPERATIONAL_MODEL.slice("contact")
_NO_SPECTRUM = np.zeros(OPERATIONAL_MODEL["s"])


def flat_device(measured: DeviceMeasurement) -> Array:
    """Return a device's measurement as a ``layout.DEVICE_SAMPLE`` (19,), SI, world axes."""
    place = pin.SE3ToXYZQUAT(measured.pose)
    return np.concatenate((place, measured.twist, measured.hand_wrench))


def flat_operational_model(model: OperationalModel, point: PointMeasurement) -> Array:
    """Return what the analysis and the mechanism report of a point as numbers (139,), without s."""
    return np.concatenate(
        (
            _NO_SPECTRUM,
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
    return DeviceMeasurement(place_of(device[_PLACE]), device[_TWIST], device[_FORCE])


def model_of(operational_model: Array) -> OperationalModel:
    """Return the analysis in numbers (139,).

    Args:
        operational_model: (139,) in SI units; see ``layout.OPERATIONAL_MODEL``.
    """
    matrices = operational_model[_MATRICES].reshape(3, 6, 6)
    return OperationalModel(matrices[0], matrices[1], matrices[2], operational_model[_FREE])


def point_of(operational_model: Array) -> PointMeasurement:
    """Return the operational point's measurement in numbers (139,).

    Args:
        operational_model: (139,) in SI units; see ``layout.OPERATIONAL_MODEL``.
    """
    place = place_of(operational_model[_POINT_PLACE])
    return PointMeasurement(place, operational_model[_POINT_TWIST], operational_model[_CONTACT])


def place_of(numbers: Array) -> pin.SE3:
    """Return the pose of a position, m, and a quaternion of any length but 0, (7,) in all.

    Args:
        numbers: (7,) position, m, and quaternion x, y, z, w.
    """
    quaternion = numbers[3:]
    length = float(np.sqrt(quaternion @ quaternion))
    return pin.SE3(pin.Quaternion(quaternion / length).matrix(), numbers[:3])
