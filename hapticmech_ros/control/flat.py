"""Measurements as flat arrays: what travels between nodes, and what the compiled control reads.

    device (19,)     position 3, quaternion x y z w 4, twist 6, F_h 6
    rendered (133,)  X 36, P_c 36, Π 36, a_0 6, position 3, quaternion 4, twist 6, F_c 6

Matrices go row by row; units and frames are those of the measurements.
"""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from hapticmech_ros.control.measurements import (
    DeviceMeasurement,
    PointMeasurement,
    RenderingModel,
)
from hapticmech_ros.mechanism.model import Array

DEVICE_SIZE = 19
RENDERED_SIZE = 133


def flat_device(measured: DeviceMeasurement) -> Array:
    """Return a device's measurement as numbers (19,)."""
    place = pin.SE3ToXYZQUAT(measured.pose)
    return np.concatenate((place, measured.twist, measured.hand_wrench))


def flat_rendered(model: RenderingModel, point: PointMeasurement) -> Array:
    """Return what the analysis and the mechanism report of a point as numbers (133,)."""
    return np.concatenate(
        (
            model.inverse_inertia.ravel(),
            model.constraint_projector.ravel(),
            model.balanced_share.ravel(),
            model.free_acceleration,
            pin.SE3ToXYZQUAT(point.pose),
            point.twist,
            point.contact_wrench,
        )
    )


def device_of(device: Array) -> DeviceMeasurement:
    """Return the measurement that numbers (19,) stand for, of any length of quaternion but 0."""
    return DeviceMeasurement(place_of(device[:7]), device[7:13], device[13:])


def model_of(rendered: Array) -> RenderingModel:
    """Return the analysis in numbers (133,)."""
    matrices = rendered[:108].reshape(3, 6, 6)
    return RenderingModel(matrices[0], matrices[1], matrices[2], rendered[108:114])


def point_of(rendered: Array) -> PointMeasurement:
    """Return the operational point's measurement in numbers (133,)."""
    return PointMeasurement(place_of(rendered[114:121]), rendered[121:127], rendered[127:])


def place_of(numbers: Array) -> pin.SE3:
    """Return the pose of a position, m, and a quaternion of any length but 0, (7,) in all."""
    quaternion = numbers[3:]
    length = float(np.sqrt(quaternion @ quaternion))
    return pin.SE3(pin.Quaternion(quaternion / length).matrix(), numbers[:3])
