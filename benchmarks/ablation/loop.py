# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A session's tick with a clock between its parts."""

from __future__ import annotations

from time import perf_counter_ns

import numpy as np

from hapticmech_ros.numerics import Array
from hapticmech_ros.scene import Scene
from hapticmech_ros.session import Session
from hapticmech_ros.session.tick_kernels import DEVICE, MECHANISM, OBSERVE, RECEIVE, RENDER, SENSE

# In the order of a tick.
PARTS = ("observe", "control", "device", "step")
_PHASES = (SENSE | OBSERVE | RECEIVE, RENDER, DEVICE, MECHANISM)


class Loop(Session):
    """A session whose tick is one call of the kernel for each part, to the bit.

    Attributes:
        taken_ns: (4,) time of each of ``PARTS`` in the ticks since it was last set, ns; with what
            is done in Python for that part.
    """

    def __init__(self, scene: Scene) -> None:
        self.taken_ns: Array = np.zeros(len(PARTS))
        super().__init__(scene)

    def timed(self, ticks: int) -> Array:
        """Do so many ticks, and return the time (ticks, 4) of each of ``PARTS``, ns."""
        rows = np.zeros((ticks, len(PARTS)))
        for row in rows:
            self.taken_ns = row
            self.tick()
        return rows

    def _call(self, phases: int, inputs: Array, rows: Array, ticks: int = 1) -> int:
        for part, own in enumerate(_PHASES):
            if not phases & own:
                continue
            begun = perf_counter_ns()
            code = super()._call(phases & own, inputs, rows, ticks)
            self.taken_ns[part] += perf_counter_ns() - begun
            if code:
                return code
        return 0

    def _finish_step(self) -> None:
        begun = perf_counter_ns()
        super()._finish_step()
        self.taken_ns[-1] += perf_counter_ns() - begun
