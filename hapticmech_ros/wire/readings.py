"""Messages of the control rate, checked but not taken apart: what the compiled control reads.

They keep the same rules as in :mod:`~hapticmech_ros.wire.layouts`. A kernel lets pass what keeps
them beyond doubt; whatever else comes goes the long way there, which names the rule.
"""

from __future__ import annotations

from typing import NamedTuple

from hapticmech_ros.mechanism.model import Array
from hapticmech_ros.wire.kernels import UNSOUND, stamp_if_sound
from hapticmech_ros.wire.layouts import (
    COMMANDED,
    DEVICE_FIELDS,
    DEVICE_MEASURED,
    GRASP,
    QUATERNION_TOLERANCE,
    RENDERED,
    RENDERING_FIELDS,
    unpack_device,
    unpack_rendering,
)

_DEVICE_SIZE = sum(DEVICE_FIELDS.values())
_RENDERING_SIZE = sum(RENDERING_FIELDS.values())


class DeviceReading(NamedTuple):
    """A ``device/state`` message.

    Attributes:
        stamp_ns: its time, ns.
        measured: (19,) as control/flat.py describes it.
        round_trip: s, from a sample to its answer, as the device finds it; 0: not known.
        obeys: whether the device obeys servo_cf.
    """

    stamp_ns: int
    measured: Array
    round_trip: float
    obeys: bool


class RenderingReading(NamedTuple):
    """A ``rendering`` message.

    Attributes:
        stamp_ns: time it stands for, ns.
        rendered: (133,) analysis and operational point, as control/flat.py describes them.
        commanded: whether the mechanism heard the controller's commands then.
        grasp: bytes of where the operational point is: others, where it is elsewhere.
    """

    stamp_ns: int
    rendered: Array
    commanded: bool
    grasp: bytes


def read_device(values: Array) -> DeviceReading:
    """Return what the control needs of a message's data.

    Raises:
        InvalidInputError: as :func:`~hapticmech_ros.wire.layouts.unpack_device` does.
    """
    # Numbers inside a message's bytes need not lie as kernels expect.
    values = values.copy()
    stamp = _stamp(values, _DEVICE_SIZE, 5)
    if stamp == UNSOUND:
        sample = unpack_device(values)
        told = sample.round_trip, sample.obeys
        return DeviceReading(sample.stamp_ns, values[DEVICE_MEASURED], *told)
    return DeviceReading(stamp, values[DEVICE_MEASURED], values.item(-2), values.item(-1) != 0.0)


def read_rendering(values: Array) -> RenderingReading:
    """Return what the control needs of a message's data.

    Raises:
        InvalidInputError: as :func:`~hapticmech_ros.wire.layouts.unpack_rendering` does.
    """
    values = values.copy()
    stamp = _stamp(values, _RENDERING_SIZE, 127)
    if stamp == UNSOUND:
        stamp = unpack_rendering(values).stamp_ns
    commanded, grasp = values.item(COMMANDED) != 0.0, values[GRASP].tobytes()
    return RenderingReading(stamp, values[RENDERED], commanded, grasp)


def _stamp(values: Array, size: int, quaternion: int) -> int:
    if values.size != size:
        return UNSOUND
    return stamp_if_sound(values, quaternion, QUATERNION_TOLERANCE)
