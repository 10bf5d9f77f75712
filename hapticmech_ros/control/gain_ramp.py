# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""From one set of gains to another, without a bump."""

from __future__ import annotations

from typing import NamedTuple, TypeVar

from hapticmech_ros.scene.controller import Controller
from hapticmech_ros.scene.part import Part

P = TypeVar("P", bound=Part)


class GainRamp(NamedTuple):
    """Gains on their way to others, all in a straight line over the new ones' ``gain_ramp``.

    A spring that becomes stiffer while it is stretched takes up energy: the ledger tells it, and
    passivity control does not give it away.

    Attributes:
        start: s.
        old, new: gains before and after.
        old_delay, new_delay: one-way delays (s) that they are for.
    """

    start: float
    old: Controller
    new: Controller
    old_delay: float = 0.0
    new_delay: float = 0.0

    def at(self, time: float) -> tuple[Controller, bool]:
        """Return the gains of ``time`` (s), and whether they are the new ones."""
        share = self._share(time)
        if share >= 1.0:
            return self.new, True
        return blended(self.old, self.new, share), False

    def delay_at(self, time: float) -> float:
        """Return the one-way delay (s) that the gains of ``time`` (s) are for."""
        share = min(self._share(time), 1.0)
        return self.old_delay * (1.0 - share) + self.new_delay * share

    def _share(self, time: float) -> float:
        ramp = self.new.gain_ramp
        return max((time - self.start) / ramp, 0.0) if ramp > 0.0 else 1.0


def blended(old: P, new: P, share: float) -> P:
    """Return a part whose numbers are so far from old to new; what is no number is new."""
    changed = {}
    for name in type(new).model_fields:
        before, after = getattr(old, name), getattr(new, name)
        if isinstance(after, Part):
            changed[name] = blended(before, after, share)
        elif isinstance(after, float) and before != after:
            changed[name] = before + share * (after - before)
    return new.model_copy(update=changed)
