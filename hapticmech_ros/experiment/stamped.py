# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Samples of one topic of a bag, in order of their stamps."""

from __future__ import annotations

from typing import Any

import numpy as np
import pinocchio as pin

from hapticmech_ros.arrays import Array
from hapticmech_ros.errors import BagError, InvalidInputError
from hapticmech_ros.quaternions import quaternion_of
from hapticmech_ros.times import NANOSECONDS
from hapticmech_ros.wire.layouts import (
    ENERGY_NAMES,
    unpack_device,
    unpack_energy,
    unpack_operational_model,
)

ARRAY_TYPE = "std_msgs/msg/Float64MultiArray"


class StampedSamples:
    """Collects the messages of one topic as numbers.

    Args:
        topic: full name, for error messages.
        kind: its message type: a stamped wrench, joint states, or ``state``,
            ``operational_model`` or ``energy`` for the arrays of wire/layouts.py.
    """

    def __init__(self, topic: str, kind: str) -> None:
        self.topic = topic
        self._read = _READERS[kind]
        self._stamps: list[int] = []
        self._rows: list[Any] = []

    def add(self, message: Any) -> None:
        """Add a message.

        Raises:
            BagError: a message that is invalid for the topic.
        """
        try:
            stamp, row = self._read(message)
        except (InvalidInputError, AttributeError) as error:
            raise BagError(f"topic {self.topic}, message {len(self._stamps)}: {error}") from error
        self._stamps.append(stamp)
        self._rows.append(row)

    def ordered(self) -> tuple[Array, Array]:
        """Return increasing stamps (n,), ns, and rows (n, ...); of equal stamps the last is kept.

        Raises:
            BagError: non-finite values, or rows of different lengths.
        """
        stamps = np.array(self._stamps, dtype=np.int64)
        order = np.argsort(stamps, kind="stable")
        stamps = stamps[order]
        last = np.append(np.diff(stamps) > 0, True) if stamps.size else np.zeros(0, dtype=bool)
        try:
            rows = np.array(self._rows, dtype=float)[order[last]]
        except ValueError:
            raise BagError(f"topic {self.topic}: messages of different lengths") from None
        if not np.isfinite(rows).all():
            bad = int(np.argwhere(~np.isfinite(rows))[0][0])
            rule = "holds a value that is not finite"
            raise BagError(f"topic {self.topic}, message {bad} in order of time: {rule}")
        return stamps[last], rows


def _stamp_ns(header: Any) -> int:
    return int(header.stamp.sec) * NANOSECONDS + int(header.stamp.nanosec)


def _wrench(message: Any) -> tuple[int, tuple[float, ...]]:
    f, t = message.wrench.force, message.wrench.torque
    return _stamp_ns(message.header), (f.x, f.y, f.z, t.x, t.y, t.z)


def _joints(message: Any) -> tuple[int, Array]:
    return _stamp_ns(message.header), np.array(message.position, dtype=float)


def _operational_model(message: Any) -> tuple[int, Array]:
    """Return a row: count, position (3), quaternion (4), Π (36), s (t)."""
    found = unpack_operational_model(message.data)
    share = found.model.wrench_projector
    pose = _pose_row(found.point.pose)
    return found.stamp_ns, np.concatenate(([found.count], pose, share.ravel(), found.s))


def _device(message: Any) -> tuple[int, Array]:
    """Return a row: position (3), quaternion (4), hand wrench (6)."""
    stamp_ns, measured, *_ = unpack_device(message.data)
    return stamp_ns, np.concatenate((_pose_row(measured.pose), measured.hand_wrench))


def _pose_row(pose: pin.SE3) -> Array:
    return np.concatenate((pose.translation, quaternion_of(pose.rotation)))


def _energy(message: Any) -> tuple[int, tuple[float, ...]]:
    """Return a row: ``ENERGY_NAMES``."""
    energy = unpack_energy(message.data)
    return energy.stamp_ns, tuple(getattr(energy, name) for name in ENERGY_NAMES)


_READERS = {
    "geometry_msgs/msg/WrenchStamped": _wrench,
    "sensor_msgs/msg/JointState": _joints,
    "state": _device,
    "operational_model": _operational_model,
    "energy": _energy,
}


def samples_of(topic: str, message_type: str) -> StampedSamples:
    """Return an empty collector for a topic; the end of its name determines an array's layout."""
    kind = topic.rsplit("/", 1)[-1] if message_type == ARRAY_TYPE else message_type
    return StampedSamples(topic, kind)
