# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The number of joint constraints in a kernel: a Schmitt trigger with dwell on each s_i."""

from __future__ import annotations

import numpy as np

from hapticmech_ros.arrays import Array
from hapticmech_ros.compilation import inner, kernel
from hapticmech_ros.layout import Field, Layout

ONE, SIX = Field(1), Field(6)
# Thresholds; dwell, s; 1 once s has been seen; per direction, s descending, 1 if it is reported as
# rigid, and since when s disagrees, s, NaN if it does not.
COUNTER = Layout(
    {**dict.fromkeys(("s_on", "s_off", "dwell", "begun"), ONE), "rigid": SIX, "since": SIX}
)
S_ON, S_OFF, DWELL, BEGUN, RIGID, SINCE = COUNTER.starts(*COUNTER)
# Absorbs the rounding of times that are sums of periods, s.
ROUNDING = 5e-10


@inner
def count_rigid(counter: Array, s: Array, time: float) -> int:
    """Return how many directions are reported as rigid; see :func:`count_constraints`."""
    count = 0
    for i in range(s.size):
        was_rigid = counter[RIGID + i] != 0.0
        if counter[BEGUN] == 0.0:
            was_rigid = bool(s[i] <= counter[S_ON])
            counter[SINCE + i] = np.nan
        disagrees = s[i] >= counter[S_OFF] if was_rigid else s[i] <= counter[S_ON]
        if not disagrees:
            counter[SINCE + i] = np.nan
        elif np.isnan(counter[SINCE + i]):
            counter[SINCE + i] = time
        if disagrees and time - counter[SINCE + i] >= counter[DWELL] - ROUNDING:
            was_rigid = not was_rigid
            counter[SINCE + i] = np.nan
        counter[RIGID + i] = 1.0 if was_rigid else 0.0
        count += int(was_rigid)
    counter[BEGUN] = 1.0
    return count


@kernel("int64(float64[::1], float64[::1], float64)")
def count_constraints(counter: Array, s: Array, time: float) -> int:
    """Return how many directions are reported as rigid, once s was seen at ``time``.

    Args:
        counter: (numbers,) a :data:`COUNTER`, changed.
        s: (t,) singular values, descending.
        time: s.
    """
    return count_rigid(counter, s, time)
