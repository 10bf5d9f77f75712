"""From one set of gains to another, without a bump."""

from __future__ import annotations

from typing import NamedTuple, TypeVar

from hapticmech_ros.scene.controller import Controller
from hapticmech_ros.scene.part import Part

P = TypeVar("P", bound=Part)


class Passage(NamedTuple):
    """Gains on their way to others, all in a straight line over the new ones' ``gain_ramp``.

    A spring that becomes stiffer while it is stretched takes up energy: the ledger tells it, and
    passivity control does not give it away.

    Attributes:
        start: s.
        old, new: gains before and after.
    """

    start: float
    old: Controller
    new: Controller

    def at(self, time: float) -> tuple[Controller, bool]:
        """Return the gains of ``time`` (s), and whether they are the new ones."""
        ramp = self.new.gain_ramp
        share = (time - self.start) / ramp if ramp > 0.0 else 1.0
        if share >= 1.0:
            return self.new, True
        return blended(self.old, self.new, max(share, 0.0)), False


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
