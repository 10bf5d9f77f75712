# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""``transmission`` and ``device/coupling_gain``: what other hands do to a point and its device."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import NamedTuple

import numpy as np

from hapticmech_ros.arrays import Array
from hapticmech_ros.layout import Field, Layout
from hapticmech_ros.scene.limits import Limits
from hapticmech_ros.wire.bounds import Bounds, bounds_of
from hapticmech_ros.wire.layouts import STAMP, checked_values
from hapticmech_ros.wire.stamps import seconds_of

_SQUARE = Field(36, ("ratio",))


class CouplingMatrices(NamedTuple):
    """A decoded message.

    Attributes:
        stamp_ns: of the mechanism's state, ns; of ``coupling_gain``, that of the device's sample
            that its command answers.
        by_point: (6, 6) by operational point that another hand holds: Y_ij, or H_j; 1, m and 1/m.
    """

    stamp_ns: int
    by_point: Mapping[str, Array]


class CouplingWire:
    """Layout of both messages: a stamp, and a matrix per other operational point.

    Args:
        others: operational points, in the scene's order.
        limits: of the scene.

    Attributes:
        fields: of the messages.
        bounds: of their numbers.
    """

    def __init__(self, others: Iterable[str], limits: Limits) -> None:
        self._others = tuple(others)
        matrices = dict.fromkeys(self._others, _SQUARE)
        self.fields = Layout({"stamp": STAMP, **matrices})
        self.bounds: Bounds = bounds_of("coupling", self.fields, limits)

    def pack(self, found: CouplingMatrices) -> Array:
        """Return a message's data (n,); zero for a point that ``by_point`` has not."""
        values = np.zeros(self.fields.size)
        values[:2] = seconds_of(found.stamp_ns)
        for name, matrix in found.by_point.items():
            values[self.fields.slice(name)] = matrix.ravel()
        return values

    def unpack(self, data: object) -> CouplingMatrices:
        """Return the decoded message, without matrices that are zero.

        Raises:
            InvalidInputError: as :meth:`~hapticmech_ros.wire.bounds.Bounds.stamp`.
        """
        stamp, values = checked_values(data, self.bounds)
        parts = {name: values[self.fields.slice(name)] for name in self._others}
        matrices = {name: part.reshape(6, 6) for name, part in parts.items() if part.any()}
        return CouplingMatrices(stamp, matrices)
