# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Whether a robot swings about its target: a loop that does not bear what the robot carries.

The observer of R6 makes a loop that bears no more than some multiple of the inertia it knows
(:mod:`.tuning`); beyond that it swings, and swings grow. What tells a swing from a target that
moves, a contact or a blocked robot is that the speed relative to the target turns round, again and
again. A reversal is a relative twist with a part of at least `speed` against the largest one since
the last reversal, which was as large. `REVERSALS` within `WINDOW` / ω are a swing: three periods of
what a loop with κ = ω does with ρ = 50 times its inertia, which turns at about √3/2 ω / ∛ρ.
"""

from __future__ import annotations

from collections import deque

import numpy as np

from hapticmech_ros.arrays import Array

# 6 π over the angular rate 50^(-1/3) √3 / 2 of ω.
REVERSALS, WINDOW = 6, 80.0


class SwingWatch:
    """Counts reversals of a relative speed.

    Args:
        speed: m/s, that counts.
        lever: m, that makes speeds of angular ones.
        window: s, within which reversals are a swing.
    """

    def __init__(self, speed: float, lever: float, window: float) -> None:
        self._window = window
        self._speed, self._scale = speed, np.repeat((1.0, lever), 3)
        self._peak = np.zeros(6)
        self._times: deque[float] = deque(maxlen=REVERSALS)

    def begin(self) -> None:
        """Forget all reversals."""
        self._peak = np.zeros(6)
        self._times.clear()

    def swings(self, twist: Array, time: float) -> bool:
        """Return whether it swings now.

        Args:
            twist: (6,) of the point relative to its target, m/s and rad/s.
            time: s.
        """
        twist = twist * self._scale
        size, largest = float(np.linalg.norm(twist)), float(np.linalg.norm(self._peak))
        against = -float(twist @ self._peak)
        if largest >= self._speed and against >= self._speed * largest:
            self._times.append(time)
            self._peak = twist
        elif size > largest:
            self._peak = twist
        return len(self._times) == REVERSALS and time - self._times[0] <= self._window
