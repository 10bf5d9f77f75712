"""Loops closed in the device: commands corrected by what it has done since their sample."""

from __future__ import annotations

from collections import OrderedDict

from hapticmech_ros.control.local_model import corrected
from hapticmech_ros.mechanism.model import Array
from hapticmech_ros.nodes.inputs import Latest, Stamped
from hapticmech_ros.times import NANOSECONDS
from hapticmech_ros.wire.bounds import Bounds
from hapticmech_ros.wire.gain_wire import ServoGain, gain_bounds, unpack_gain

# A gain older than this says nothing of where the mechanism is now.
FRESH_NS = NANOSECONDS // 10
# Samples that are remembered: a loop of so many periods can be corrected.
REMEMBERED = 2048


class LocalLoop:
    """Remembers samples, and corrects commands that answer them.

    Args:
        bounds: of the gains that it is told.

    Attributes:
        gains: by stamp, in lockstep.
        to_mechanism: E_m as it was told last, J; None before.
    """

    def __init__(self, bounds: Bounds | None = None) -> None:
        self._bounds = bounds or gain_bounds()
        self.gains: Stamped[ServoGain] = Stamped()
        self.to_mechanism: float | None = None
        self._gain: Latest[ServoGain] = Latest()
        self._samples: OrderedDict[int, Array] = OrderedDict()

    def measured(self, sample: Array, stamp_ns: int) -> None:
        """Remember a sample (19,)."""
        self._samples[stamp_ns] = sample.copy()
        if len(self._samples) > REMEMBERED:
            self._samples.popitem(last=False)

    def take(self, values: Array, now_ns: int, lockstep: bool) -> None:
        """Take a ``servo_gain`` message's data.

        Raises:
            InvalidInputError: as :func:`~hapticmech_ros.wire.gain_wire.unpack_gain`.
        """
        gain = unpack_gain(values, self._bounds)
        if lockstep:
            self.gains.put(gain, gain.stamp_ns)
        else:
            self._gain.put(gain, now_ns)
            self.to_mechanism = gain.to_mechanism

    def forget(self) -> None:
        """Correct nothing until there is a gain."""
        self._gain = Latest()
        self.to_mechanism = None

    def correct(self, command: Array, answered_ns: int, now_ns: int) -> Array:
        """Return a command (6,) corrected by the gain that stands, if its sample is remembered."""
        gain = self._gain.value
        if gain is None or not self._gain.fresh(now_ns, FRESH_NS):
            return command
        return self._corrected(command, gain, answered_ns)

    def correct_in_lockstep(self, command: Array, stamp_ns: int) -> Array:
        """Return a command (6,) corrected by the gain that goes with it."""
        gain = self.gains.take(stamp_ns)
        self.to_mechanism = gain.to_mechanism
        return self._corrected(command, gain, gain.answered_ns)

    def _corrected(self, command: Array, gain: ServoGain, answered_ns: int) -> Array:
        then = self._samples.get(answered_ns)
        if then is None:
            return command
        return corrected(command, gain.model, then, next(reversed(self._samples.values())))
