# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What messages for people hold: looked at before they leave, as those of the control rate are."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from typing import Any

import numpy as np
from geometry_msgs.msg import (
    Point,
    Pose,
    PoseStamped,
    Quaternion,
    TransformStamped,
    TwistStamped,
    Vector3,
    WrenchStamped,
)
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray
from visualization_msgs.msg import Marker, MarkerArray

from hapticmech_ros.errors import OutputError


def check_finite(message: Any) -> None:
    """Refuse to send a message with a number that is not finite.

    Raises:
        OutputError: there is one.
    """
    numbers = _NUMBERS.get(type(message))
    if numbers is None:
        return
    for value in numbers(message):
        if not math.isfinite(value):
            raise OutputError(type(message).__name__, float(value), "must be finite")


def _vector(v: Vector3 | Point) -> tuple[float, float, float]:
    return v.x, v.y, v.z


def _turn(q: Quaternion) -> tuple[float, float, float, float]:
    return q.x, q.y, q.z, q.w


def _pose(pose: Pose) -> tuple[float, ...]:
    return *_vector(pose.position), *_turn(pose.orientation)


def _array(message: Float64MultiArray) -> Iterable[float]:
    values = np.frombuffer(message.data)
    wrong = ~np.isfinite(values)
    return values[wrong].tolist()[:1] if wrong.any() else ()


def _markers(message: MarkerArray) -> Iterable[float]:
    for marker in message.markers:
        yield from _marker(marker)


def _marker(marker: Marker) -> Iterable[float]:
    yield from _pose(marker.pose)
    yield from _vector(marker.scale)
    for point in marker.points:
        yield from _vector(point)


def _transform(message: TransformStamped) -> tuple[float, ...]:
    place = message.transform
    return *_vector(place.translation), *_turn(place.rotation)


_NUMBERS: dict[type, Callable[[Any], Iterable[float]]] = {
    WrenchStamped: lambda m: (*_vector(m.wrench.force), *_vector(m.wrench.torque)),
    TwistStamped: lambda m: (*_vector(m.twist.linear), *_vector(m.twist.angular)),
    PoseStamped: lambda m: _pose(m.pose),
    JointState: lambda m: (*m.position, *m.velocity, *m.effort),
    Float64MultiArray: _array,
    TransformStamped: _transform,
    MarkerArray: _markers,
}
