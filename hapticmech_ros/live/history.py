# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The last seconds of what is plotted."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable

import numpy as np

from hapticmech_ros.arrays import Array
from hapticmech_ros.live.commands import LiveState

# How long plots look back, s, and how often a value is kept.
SECONDS, PERIOD_S = 10.0, 0.05


class History:
    """Count, spectrum, forces and rate over the session's time."""

    def __init__(self) -> None:
        self._directions = 0
        self._rows: deque[Array] = deque()

    def begin(self, directions: int) -> None:
        """Forget all; from now on spectra have so many directions."""
        self._directions = directions
        self._rows.clear()

    def add(self, state: LiveState) -> None:
        """Add a state, unless the last one is too near; one of an earlier time begins anew."""
        if self._rows and state.time < self._rows[-1][0]:
            self._rows.clear()
        if self._rows and state.time - self._rows[-1][0] < PERIOD_S:
            return
        while self._rows and state.time - self._rows[0][0] > SECONDS:
            self._rows.popleft()
        head = (
            state.time,
            state.count,
            float(np.linalg.norm(state.hand_wrench[:3])),
            float(np.linalg.norm(state.on_hand[:3])),
            state.factor,
        )
        self._rows.append(np.array((*head, *state.observation[: self._directions])))

    def count(self) -> tuple[Array, ...]:
        """Return times (n,), s, and the number of joint constraints (n,)."""
        return self._columns(0, 1)

    def spectrum(self) -> tuple[Array, ...]:
        """Return times (n,), s, and s_i (n,), as many as there are directions."""
        return self._columns(0, *range(5, 5 + self._directions))

    def forces(self) -> tuple[Array, ...]:
        """Return times (n,), s, and norms (n,) of F_h and of the device's force on the hand, N."""
        return self._columns(0, 2, 3)

    def rate(self) -> tuple[Array, ...]:
        """Return times (n,), s, and the real-time factor (n,)."""
        return self._columns(0, 4)

    def plots(self) -> tuple[tuple[str, tuple[str, ...], Callable[[], tuple[Array, ...]]], ...]:
        """Return every plot: title, names of lines, and what gives times (n,), values (n,)."""
        spectrum = tuple(f"s{i + 1}" for i in range(self._directions))
        return (
            ("joint constraints", ("count",), self.count),
            ("s", spectrum, self.spectrum),
            ("forces, N", ("by the hand", "by the device"), self.forces),
            ("real-time factor", ("factor",), self.rate),
        )

    def _columns(self, *columns: int) -> tuple[Array, ...]:
        rows = np.array(self._rows) if self._rows else np.zeros((1, 5 + self._directions))
        return tuple(np.ascontiguousarray(rows[:, column]) for column in columns)
