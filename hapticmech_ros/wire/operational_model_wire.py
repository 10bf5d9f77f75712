# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Writing ``operational_model`` messages in place, at the control rate."""

from __future__ import annotations

import numpy as np

from hapticmech_ros.arrays import Array
from hapticmech_ros.operational import Analyser
from hapticmech_ros.operational.observation import Observation, PastRates
from hapticmech_ros.wire.kernels import COUNT, MODEL, write_operational_model
from hapticmech_ros.wire.layouts import OPERATIONAL_MODEL_FIELDS
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
        told = state.contacts[at], float(state.commanded[at]), state.grasps[at]
        write_operational_model(self.values, state.stamp_ns, found.model, *told)
        return found

    def count(self, count: int) -> None:
        """Write the number of joint constraints reported."""
        self.values[COUNT] = count
