# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Messages of the control rate, checked but not taken apart: what the compiled control reads.

They keep the same rules as in :mod:`~hapticmech_ros.wire.layouts`; see
:mod:`~hapticmech_ros.wire.bounds`.
"""

from __future__ import annotations

from typing import NamedTuple

from hapticmech_ros.arrays import Array
from hapticmech_ros.scene.limits import Limits
from hapticmech_ros.wire.bounds import Bounds, SixBounds, twist_bounds
from hapticmech_ros.wire.layouts import (
    COMMANDED,
    DEVICE_MEASURED,
    GRASP,
    OBEYS,
    POINT_MODEL_PART,
    ROUND_TRIP,
    device_bounds,
    operational_model_bounds,
    whole_device,
)

_DEVICE, _OPERATIONAL_MODEL = device_bounds(), operational_model_bounds()


class ReadingBounds(NamedTuple):
    """Bounds of what a controller reads: ``device/state``, ``operational_model``, and twists."""

    device: Bounds
    model: Bounds
    twist: SixBounds


class DeviceReading(NamedTuple):
    """A ``device/state`` message.

    Attributes:
        stamp_ns: its time, ns.
        measured: (19,) a device's sample; see :mod:`~hapticmech_ros.layout`.
        round_trip: s, from a sample to its answer, as the device finds it; 0: not known.
        obeys: whether the device obeys servo_cf.
    """

    stamp_ns: int
    measured: Array
    round_trip: float
    obeys: bool


class OperationalModelReading(NamedTuple):
    """An ``operational_model`` message.

    Attributes:
        stamp_ns: time it stands for, ns.
        operational_model: (139,) an operational model; see :mod:`~hapticmech_ros.layout`.
        commanded: whether the mechanism heard the controller's commands then.
        grasp: bytes of where the operational point is: others, where it is elsewhere.
    """

    stamp_ns: int
    operational_model: Array
    commanded: bool
    grasp: bytes


def reading_bounds(limits: Limits) -> ReadingBounds:
    """Return the bounds of a scene's limits."""
    return ReadingBounds(
        device_bounds(limits), operational_model_bounds(limits), twist_bounds(limits)
    )


def read_device(values: Array, bounds: Bounds = _DEVICE) -> DeviceReading:
    """Return what the control needs of a message's data.

    Args:
        values: (n,) the data.
        bounds: of the message.

    Raises:
        InvalidInputError: as :meth:`~hapticmech_ros.wire.bounds.Bounds.stamp`.
    """
    # Numbers inside a message's bytes need not lie as kernels expect.
    values = whole_device(values.copy())
    stamp = bounds.stamp(values)
    obeys = values.item(OBEYS) != 0.0
    return DeviceReading(stamp, values[DEVICE_MEASURED], values.item(ROUND_TRIP), obeys)


def read_operational_model(
    values: Array, bounds: Bounds = _OPERATIONAL_MODEL
) -> OperationalModelReading:
    """Return what the control needs of a message's data.

    Args:
        values: (n,) the data.
        bounds: of the message.

    Raises:
        InvalidInputError: as :meth:`~hapticmech_ros.wire.bounds.Bounds.stamp`.
    """
    values = values.copy()
    stamp = bounds.stamp(values)
    commanded, grasp = values.item(COMMANDED) != 0.0, values[GRASP].tobytes()
    return OperationalModelReading(stamp, values[POINT_MODEL_PART], commanded, grasp)
