# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Passivity at the mechanism's port: it gets no more than the hand has put in.

    E_m <= E_h + slack,      E_h = Σ ½ (F_h + F_h') · ξ

over the samples that arrive. While E_m is above, the part of a wrench that would give more is taken
away: along the twist, as a damper -λ Λ_d v would that leaves f · v = 0.
"""

from __future__ import annotations

import numpy as np

from hapticmech_ros.arrays import Array
from oracles.local_model import FORCE, displacement


class PortPassivity:
    """What the hand has put in, as the controller knows it.

    Args:
        inertia: (6,) diagonal of Λ_d: makes forces and torques comparable.

    Attributes:
        from_hand: E_h, J.
        changed: wrenches that were changed.
    """

    def __init__(self, inertia: Array) -> None:
        self.from_hand = 0.0
        self.changed = 0
        self._inertia = inertia
        self._sample: Array | None = None

    def record(self, sample: Array) -> None:
        """Account for what the hand did until a sample (19,) of the device."""
        before = self._sample
        if before is not None:
            middle = 0.5 * (before[FORCE] + sample[FORCE])
            self.from_hand += float(middle @ displacement(before, sample))
        self._sample = sample

    def pause(self) -> None:
        """Leave out what the hand does until the next sample."""
        self._sample = None

    def enforce(self, wrench: Array, twist: Array) -> Array:
        """Return a wrench (6,) that gives nothing to what moves with a twist (6,)."""
        given = float(wrench @ twist)
        if given <= 0.0:
            return wrench
        self.changed += 1
        momentum = self._inertia * twist
        return np.asarray(wrench - given / float(momentum @ twist) * momentum)
