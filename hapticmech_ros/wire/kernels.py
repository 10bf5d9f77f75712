# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Kernel that checks a flat message at once, in place of several calls of NumPy."""

from __future__ import annotations

import numpy as np

from hapticmech_ros.compilation import inner, kernel, put
from hapticmech_ros.numerics import Array
from hapticmech_ros.wire.messages import (
    DeviceStateMessage,
    LocalFeedbackGain,
    OperationalModelMessage,
)

# No message has a time before this.
UNSOUND = -1
# Where quaternions are in the messages of the control rate.
MODEL_QUATERNION = OperationalModelMessage.layout.start("quaternion")
SAMPLE_QUATERNION = DeviceStateMessage.layout.start("quaternion")
# Where in a gain how a command depends on the device begins.
GAIN = LocalFeedbackGain.layout.start("force")
# Of a quaternion's length.
QUATERNION_TOLERANCE = 1e-3
_SECOND = 1_000_000_000


@inner
def write_operational_model(
    out: OperationalModelMessage,
    stamp: int,
    model: Array,
    contact: Array,
    commanded: float,
    grasp: Array,
) -> None:
    """Fill a message but for the count and the number of directions.

    Args:
        out: the message.
        stamp: of the state, ns.
        model: (139,) see ``layout.OperationalModelSample``.
        contact: (6,) F_c, N and N m, world axes.
        commanded: 1 if the mechanism acts on commands.
        grasp: (7,) where the operational point is.
    """
    out.stamp[0], out.stamp[1] = stamp // _SECOND, stamp % _SECOND
    put(out.operational_model.values, model)
    put(out.operational_model.contact, contact)
    out.commanded = commanded
    put(out.grasp, grasp)


@kernel(
    "int64(Array(float64, 1, 'C', readonly=True), Array(float64, 1, 'C', readonly=True), "
    "int64, float64)"
)
def sound_stamp(values: Array, most: Array, quaternion: int, tolerance: float) -> int:
    """Return the time (ns) of a message, or :data:`UNSOUND`.

    A sound message certainly keeps the rules: all numbers are finite and within their bounds, the
    quaternion's length is 1 within half the tolerance, and the stamp has whole numbers.

    Args:
        values: (n,) the data, which begins with seconds and nanoseconds.
        most: (n,) largest magnitude of each.
        quaternion: index of the first of its four numbers; below 0 for none.
        tolerance: of the quaternion's length.
    """
    for i in range(values.size):
        if not abs(values[i]) <= most[i]:
            return UNSOUND
    if quaternion >= 0:
        square = 0.0
        for i in range(quaternion, quaternion + 4):
            square += values[i] * values[i]
        if abs(np.sqrt(square) - 1.0) > 0.5 * tolerance:
            return UNSOUND
    # Within their bounds by now: they fit into whole numbers.
    seconds, nanoseconds = int(values[0]), int(values[1])
    if values[0] != seconds or values[1] != nanoseconds or seconds < 0 or nanoseconds < 0:
        return UNSOUND
    return seconds * 1_000_000_000 + nanoseconds
