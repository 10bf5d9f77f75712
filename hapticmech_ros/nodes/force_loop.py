"""The force channel closed in the device: commands corrected by what the hand has done since."""

from __future__ import annotations

from collections import OrderedDict

import numpy as np

from hapticmech_ros.control.force_gain import corrected
from hapticmech_ros.mechanism.model import Array
from hapticmech_ros.nodes.inputs import Latest, Stamped
from hapticmech_ros.times import NANOSECONDS
from hapticmech_ros.wire.layouts import unpack_gain

# A gain older than this says nothing of where the mechanism is now.
FRESH_NS = NANOSECONDS // 10
# Samples whose hand wrench is remembered: a loop of so many periods can be corrected.
REMEMBERED = 256


class ForceLoop:
    """Remembers hand wrenches by their samples, and corrects commands that answer them.

    Attributes:
        gains: by stamp, in lockstep.
    """

    def __init__(self) -> None:
        self.gains: Stamped[Array] = Stamped()
        self._gain: Latest[Array] = Latest()
        self._wrenches: OrderedDict[int, Array] = OrderedDict()

    def measured(self, hand_wrench: Array, stamp_ns: int) -> None:
        """Remember F_h (6,) of a sample."""
        self._wrenches[stamp_ns] = hand_wrench.copy()
        if len(self._wrenches) > REMEMBERED:
            self._wrenches.popitem(last=False)

    def take(self, values: Array, now_ns: int, lockstep: bool) -> None:
        """Take a ``servo_gain`` message's data.

        Raises:
            InvalidInputError: wrong length, or not finite.
        """
        stamp_ns, gain = unpack_gain(values)
        if lockstep:
            self.gains.put(gain, stamp_ns)
        self._gain.put(gain, now_ns)

    def forget(self) -> None:
        """Correct nothing until there is a gain."""
        self._gain = Latest()

    def correct(self, command: Array, answered_ns: int, now_ns: int) -> Array:
        """Return a command (6,) corrected by the gain that stands, if its sample is remembered."""
        gain = self._gain.value
        if gain is None or not self._gain.fresh(now_ns, FRESH_NS):
            return command
        return self._corrected(command, gain, answered_ns)

    def correct_in_lockstep(self, command: Array, answered_ns: int) -> Array:
        """Return a command (6,) corrected by the gain of the same sample."""
        return self._corrected(command, self.gains.take(answered_ns), answered_ns)

    def _corrected(self, command: Array, gain: Array, answered_ns: int) -> Array:
        then = self._wrenches.get(answered_ns)
        if then is None:
            return command
        now = next(reversed(self._wrenches.values()), np.zeros(6))
        return corrected(command, gain, then, now)
