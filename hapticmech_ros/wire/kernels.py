"""Kernel that checks a flat message at once, in place of several calls of NumPy."""

from __future__ import annotations

import numpy as np

from hapticmech_ros.compilation import kernel
from hapticmech_ros.mechanism.model import Array

# No message stands for a time before this.
UNSOUND = -1


@kernel("int64(Array(float64, 1, 'C', readonly=True), int64, float64)")
def stamp_if_sound(values: Array, quaternion: int, tolerance: float) -> int:
    """Return the time (ns) that a message stands for, or :data:`UNSOUND`.

    Sound is what certainly keeps the rules: all numbers finite; of unit length within half the
    tolerance the quaternion; a time of no more digits than a stamp has.

    Args:
        values: the message's data, which begins with seconds and nanoseconds.
        quaternion: index of the first of its four numbers.
        tolerance: of the quaternion's length.
    """
    for i in range(values.size):
        if not np.isfinite(values[i]):
            return UNSOUND
    square = 0.0
    for i in range(quaternion, quaternion + 4):
        square += values[i] * values[i]
    if abs(np.sqrt(square) - 1.0) > 0.5 * tolerance:
        return UNSOUND
    seconds, nanoseconds = values[0], values[1]
    if not (0.0 <= seconds < 4e9 and 0.0 <= nanoseconds < 1e9):
        return UNSOUND
    return int(seconds) * 1_000_000_000 + int(nanoseconds)
