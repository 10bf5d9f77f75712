"""``device/servo_gain``: how commands depend on the device, for its own loop."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from hapticmech_ros.control.local_model import LocalModel
from hapticmech_ros.mechanism.model import Array
from hapticmech_ros.times import NANOSECONDS
from hapticmech_ros.wire.layouts import checked_values

# Field -> size; ``stamp`` and ``answered`` are seconds and nanoseconds.
GAIN_FIELDS: dict[str, int] = {
    "stamp": 2,
    "answered": 2,
    "to_mechanism": 1,
    "force": 36,
    "stiffness": 36,
    "damping": 36,
}
_MODEL = 5


class ServoGain(NamedTuple):
    """A decoded ``device/servo_gain`` message.

    Attributes:
        stamp_ns: of the command that it goes with, ns.
        answered_ns: of the device's sample that this command answers, ns.
        to_mechanism: E_m, J: what the mechanism has got through its point.
        model: G, K and B.
    """

    stamp_ns: int
    answered_ns: int
    to_mechanism: float
    model: LocalModel


def pack_gain(gain: ServoGain) -> Array:
    """Return the data (113,) of a ``device/servo_gain`` message."""
    stamps = *divmod(gain.stamp_ns, NANOSECONDS), *divmod(gain.answered_ns, NANOSECONDS)
    matrices = (matrix.ravel() for matrix in gain.model)
    return np.concatenate(((*stamps, gain.to_mechanism), *matrices))


def unpack_gain(data: object) -> ServoGain:
    """Return the decoded message.

    Raises:
        InvalidInputError: wrong length, or not finite.
    """
    values = checked_values("gain", data, sum(GAIN_FIELDS.values()))
    stamp, answered = (int(values[at]) * NANOSECONDS + int(values[at + 1]) for at in (0, 2))
    model = LocalModel(*values[_MODEL:].reshape(3, 6, 6))
    return ServoGain(stamp, answered, float(values[4]), model)
