# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Number of joint constraints reported to the user: a Schmitt trigger with dwell on each s_i."""

from __future__ import annotations

import numpy as np

from hapticmech_ros.arrays import Array
from hapticmech_ros.operational.counter_kernels import BEGUN, COUNTER, count_constraints
from hapticmech_ros.scene.rendering import Perception


class ConstraintCounter:
    """Counts directions that are reported as rigid.

    A direction is rigid at first where s <= s_on. It turns rigid once s has stayed at or below s_on
    for the dwell time, and free once it has stayed at or above s_off for it; in between nothing
    changes.

    Args:
        perception: thresholds and dwell time.

    Attributes:
        numbers: a :data:`~hapticmech_ros.operational.counter_kernels.COUNTER`.
    """

    def __init__(self, perception: Perception) -> None:
        self.numbers: Array = np.zeros(COUNTER.size)
        constants = perception.s_on, perception.s_off, perception.dwell
        self.numbers[COUNTER.slice("s_on", "dwell")] = constants

    def begin(self) -> None:
        """Start anew with the next s."""
        self.numbers[BEGUN] = 0.0

    def update(self, s: Array, time: float) -> int:
        """Return the count after s was observed at ``time``.

        Args:
            s: (t,) singular values, descending.
            time: s.
        """
        return count_constraints(self.numbers, np.ascontiguousarray(s, dtype=float), time)


def rigid_count(s: Array, perception: Perception) -> int:
    """Return the count of a configuration by itself: directions with s at most s_on.

    Args:
        s: (t,) singular values, descending.
        perception: its thresholds.
    """
    return int(np.count_nonzero(s <= perception.s_on))
