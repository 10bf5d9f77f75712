# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Kernel that checks a flat message at once, in place of several calls of NumPy."""

from __future__ import annotations

import numpy as np

from hapticmech_ros.arrays import Array
from hapticmech_ros.compilation import inner, kernel

# No message stands for a time before this.
UNSOUND = -1


@inner
def sound_stamp(values: Array, most: Array, quaternion: int, tolerance: float) -> int:
    """Return the time (ns) that a message stands for, or UNSOUND; see :func:`stamp_if_sound`."""
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


@kernel(
    "int64(Array(float64, 1, 'C', readonly=True), Array(float64, 1, 'C', readonly=True), "
    "int64, float64)"
)
def stamp_if_sound(values: Array, most: Array, quaternion: int, tolerance: float) -> int:
    """Return the time (ns) that a message stands for, or :data:`UNSOUND`.

    Sound is what certainly keeps the rules: no number larger than it may be, which none is that is
    not finite; of unit length within half the tolerance the quaternion; a stamp of whole numbers.

    Args:
        values: (n,) the data, which begins with seconds and nanoseconds.
        most: (n,) largest magnitude of each.
        quaternion: index of the first of its four numbers; below 0 for none.
        tolerance: of the quaternion's length.
    """
    return sound_stamp(values, most, quaternion, tolerance)
