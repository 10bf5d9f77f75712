# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Messages of the control rate, checked but not taken apart: what the compiled control reads.

They keep the same rules as in :mod:`~hapticmech_ros.wire.layouts`; see
:mod:`~hapticmech_ros.wire.bounds`.

Writing ``operational_model`` messages in place, at the control rate.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from hapticmech_ros.numerics import Array
from hapticmech_ros.operational import Analyser
from hapticmech_ros.operational.observation import Observation, PastRates
from hapticmech_ros.scene.document import Limits
from hapticmech_ros.wire.bounds import Bounds, SixBounds, twist_bounds
from hapticmech_ros.wire.kernels import COUNT, MODEL, write_operational_model
from hapticmech_ros.wire.layouts import (
    COMMANDED,
    DEVICE_MEASURED,
    GRASP,
    OBEYS,
    OPERATIONAL_MODEL_FIELDS,
    POINT_MODEL_PART,
    ROUND_TRIP,
    device_bounds,
    operational_model_bounds,
    whole_device,
)
from hapticmech_ros.wire.state import WireState

_DIRECTIONS = OPERATIONAL_MODEL_FIELDS.start("directions")


class OperationalModelWriter:
    """An ``operational_model`` message's data, written anew for each state of the mechanism.

    The same as ``layouts.pack_operational_model``, without the objects between.

    Args:
        analyser: of the point.
        past: rates of the states that were written before.
        values: (151,) where to write; an array of its own if left out.

    Attributes:
        values: (151,) the data.
        s: (t,) singular values of the state seen last; a view.
    """

    def __init__(self, analyser: Analyser, past: PastRates, values: Array | None = None) -> None:
        self._analyser, self._past = analyser, past
        self._index = analyser.index
        size = OPERATIONAL_MODEL_FIELDS.size
        self.values: Array = np.zeros(size) if values is None else values
        self.values[_DIRECTIONS] = analyser.rows.size
        self.s: Array = self.values[MODEL : MODEL + analyser.rows.size]

    def evaluate(self, state: WireState) -> Observation:
        """Write all but the count, and return what was found.

        Raises:
            HapticMechError: the state cannot be analysed.
        """
        before = self._past.before(state.stamp_ns, state.active)
        found = self._analyser.observe(state.q, state.v, state.active, before=before)
        self._past.add(state.stamp_ns, state.v, state.active)
        at = self._index
        reported = state.contacts[at], float(state.commanded[at]), state.grasps[at]
        write_operational_model(self.values, state.stamp_ns, found.model, *reported)
        return found

    def count(self, count: int) -> None:
        """Write the number of joint constraints reported."""
        self.values[COUNT] = count


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
        measured: (19,) a device's sample; see :mod:`~hapticmech_ros.numerics.layout`.
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
        operational_model: (139,) an operational model; see :mod:`~hapticmech_ros.numerics.layout`.
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
