# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What nodes sent while somebody sent what nobody should: finite, and no more than actuators may.

Of a device that is at zero all the while this says nothing: how often it had force is counted too.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Iterable
from typing import Any

import numpy as np
from geometry_msgs.msg import WrenchStamped
from rclpy.serialization import deserialize_message
from std_msgs.msg import Float64MultiArray

from benchmarks.reliability.figure import Figure, figures_of
from hapticmech_ros.numerics import Array
from hapticmech_ros.scene.device import Device
from hapticmech_ros.wire.cdr import decode
from hapticmech_ros.wire.messages import DeviceStateMessage
from hapticmech_ros.wire.topics import DEVICE_STATE

# Of a device that is to render meanwhile: share of its samples, and of its limit.
LEAST_SHARE, LEAST_FORCE = 0.2, 0.9
EXAMPLES, ROUNDING = 20, 1.0 + 1e-9


class Outputs:
    """Looks at messages that nodes send.

    Attributes:
        device: whose limits count.
        messages: that were looked at.
        not_finite: of these, how many have a number that is not finite.
        samples: of ``device/state``.
        pushed: of these, how many had force.
        beyond: how many had more force or torque than the device may give.
        largest: N, of all.
        examples: of what was wrong, the first ones.
    """

    def __init__(self, device: Device) -> None:
        self.device = device
        self.messages = self.not_finite = self.samples = self.pushed = self.beyond = 0
        self.largest = 0.0
        self.examples: list[str] = []

    def look(self, topic: str, kind: Any, message: Any) -> None:
        """Look at a message, or at its bytes."""
        self.messages += 1
        if wrong := [one for one in numbers_of(kind, message) if not math.isfinite(one)]:
            self.not_finite += 1
            self._keep(f"{topic}: {wrong[:3]}")
        if topic.endswith(DEVICE_STATE.name):
            self.look_at(applied_in(message))

    def look_at(self, applied: Array) -> None:
        """Look at what a device's actuators apply (6,), N and N m."""
        force, torque = float(np.linalg.norm(applied[:3])), float(np.linalg.norm(applied[3:]))
        self.samples += 1
        self.pushed += not force <= 0.0
        self.largest = max(self.largest, force)
        most, most_torque = self.device.force_limit, self.device.torque_limit
        if not (force <= ROUNDING * most and torque <= ROUNDING * most_torque):
            self.beyond += 1
            self._keep(f"beyond the limits: {applied.tolist()}")

    def figures(self, where: str, renders: bool) -> list[Figure]:
        """Return what was seen.

        Args:
            where: the messages were sent.
            renders: the device has to have force meanwhile, up to its limit.
        """
        share = self.pushed / max(self.samples, 1)
        reached = self.largest / self.device.force_limit
        shares, forces = (LEAST_SHARE, LEAST_FORCE) if renders else (None, None)

        figure = figures_of(where, self.samples)
        return [
            figure("samples beyond the force limit", self.beyond, most=0.0),
            figure("share of samples with force", share, least=shares),
            figure("largest force, of the limit", reached, least=forces),
        ]

    def _keep(self, text: str) -> None:
        if len(self.examples) < EXAMPLES:
            self.examples.append(text)


def applied_in(message: bytes) -> np.ndarray:
    """Return what actuators apply (6,) by a whole ``device/state`` message."""
    values = np.frombuffer(message[-8 * DeviceStateMessage.layout.size :])
    return values[DeviceStateMessage.layout.slice("applied")]


def numbers_of(kind: Any, message: Any) -> Iterable[float]:
    """Return all numbers of a message or its bytes, those of an array at once."""
    if isinstance(message, bytes):
        if kind is Float64MultiArray:
            values = decode(message)
            return () if np.isfinite(values).all() else values.tolist()
        if kind is WrenchStamped:
            return struct.unpack("<6d", message[-48:])
        message = deserialize_message(message, kind)
    return _numbers(message)


def _numbers(value: Any) -> Iterable[float]:
    if isinstance(value, float):
        yield value
    elif hasattr(value, "get_fields_and_field_types"):
        for name in value.get_fields_and_field_types():
            yield from _numbers(getattr(value, name))
    elif hasattr(value, "typecode"):
        yield from map(float, value)
    elif isinstance(value, list | tuple | np.ndarray):
        for one in value:
            yield from _numbers(one)
