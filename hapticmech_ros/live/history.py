# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The last seconds of what is plotted."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator, Sequence
from functools import partial

import numpy as np

from hapticmech_ros.arrays import Array
from hapticmech_ros.live.commands import LiveState

# How long plots look back, s, and how often a value is kept.
SECONDS, PERIOD_S = 10.0, 0.05


class History:
    """Rate, and every user's count, spectrum and forces, over the session's time."""

    def __init__(self) -> None:
        self._users: tuple[str, ...] = ()
        self._directions = 0
        self._rows: deque[Array] = deque()

    def begin(self, users: Sequence[str], directions: int) -> None:
        """Forget all; from now on it is of these users, whose spectra have so many directions."""
        self._users, self._directions = tuple(users), directions
        self._rows.clear()

    def add(self, state: LiveState) -> None:
        """Add a state, unless the last one is too near; one of an earlier time begins anew."""
        if self._rows and state.time < self._rows[-1][0]:
            self._rows.clear()
        if self._rows and state.time - self._rows[-1][0] < PERIOD_S:
            return
        while self._rows and state.time - self._rows[0][0] > SECONDS:
            self._rows.popleft()
        row = [state.time, state.factor]
        for user in state.users:
            forces = (user.hand_wrench[:3], user.on_hand[:3])
            row += [user.count, *(float(np.linalg.norm(force)) for force in forces)]
            row += user.observation[: self._directions].tolist()
        self._rows.append(np.array(row))

    def count(self, user: int = 0) -> tuple[Array, ...]:
        """Return times (n,), s, and the number of joint constraints (n,) that a user feels."""
        return self._columns(self._first(user))

    def spectrum(self, user: int = 0) -> tuple[Array, ...]:
        """Return times (n,), s, and a user's s_i (n,), as many as there are directions."""
        first = self._first(user) + 3
        return self._columns(*range(first, first + self._directions))

    def forces(self, user: int = 0) -> tuple[Array, ...]:
        """Return times (n,), s, and norms (n,) of a user's F_h and of the device's force, N."""
        first = self._first(user) + 1
        return self._columns(first, first + 1)

    def rate(self) -> tuple[Array, ...]:
        """Return times (n,), s, and the real-time factor (n,)."""
        return self._columns(1)

    def plots(self) -> Iterator[tuple[str, tuple[str, ...], Callable[[], tuple[Array, ...]]]]:
        """Yield every plot: title, names of lines, and what gives times (n,), values (n,)."""
        spectrum = tuple(f"s{i + 1}" for i in range(self._directions))
        several = len(self._users) > 1
        for index, user in enumerate(self._users):
            of = f" ({user})" if several else ""
            yield f"joint constraints{of}", ("count",), partial(self.count, index)
            yield f"s{of}", spectrum, partial(self.spectrum, index)
            names = ("by the hand", "by the device")
            yield f"forces, N{of}", names, partial(self.forces, index)
        yield "real-time factor", ("factor",), self.rate

    def _first(self, user: int) -> int:
        """Return the column in which a user's values begin."""
        return 2 + user * (3 + self._directions)

    def _columns(self, *columns: int) -> tuple[Array, ...]:
        width = self._first(len(self._users))
        rows = np.array(self._rows) if self._rows else np.zeros((1, width))
        return tuple(np.ascontiguousarray(rows[:, column]) for column in (0, *columns))
