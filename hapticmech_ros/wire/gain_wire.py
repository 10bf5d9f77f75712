# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""``device/local_feedback_gain``: how commands depend on the device, for its own loop."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from hapticmech_ros.arrays import Array
from hapticmech_ros.layout import Field, Layout
from hapticmech_ros.scene.limits import Limits
from hapticmech_ros.wire.bounds import Bounds, bounds_of
from hapticmech_ros.wire.layouts import STAMP, checked_values
from hapticmech_ros.wire.stamps import seconds_of, stamp_of

GAIN_FIELDS = Layout(
    {
        "stamp": STAMP,
        "answered": STAMP,
        "to_mechanism": Field(1, ("energy",)),
        "force": Field(36, ("ratio",)),
        "stiffness": Field(36, ("stiffness",)),
        "damping": Field(36, ("damping",)),
    }
)
_ANSWERED, _MODEL = GAIN_FIELDS.slice("answered"), GAIN_FIELDS.slice("force", "damping")
_TO_MECHANISM = GAIN_FIELDS.start("to_mechanism")


class LocalFeedbackGain(NamedTuple):
    """A decoded ``device/local_feedback_gain`` message.

    Attributes:
        stamp_ns: of the command that it goes with, ns.
        answered_ns: of the device's sample that this command answers, ns.
        to_mechanism: E_m, J: what the mechanism has got through its point.
        model: (108,) G, K and B, row by row.
    """

    stamp_ns: int
    answered_ns: int
    to_mechanism: float
    model: Array


def pack_gain(gain: LocalFeedbackGain) -> Array:
    """Return the data (113,) of a ``device/local_feedback_gain`` message."""
    stamps = *seconds_of(gain.stamp_ns), *seconds_of(gain.answered_ns)
    return np.concatenate(((*stamps, gain.to_mechanism), gain.model))


def gain_bounds(limits: Limits | None = None) -> Bounds:
    """Return the bounds of ``local_feedback_gain``; of finite numbers where no scene is known."""
    return bounds_of("gain", GAIN_FIELDS, limits)


_ANY = gain_bounds()


def unpack_gain(data: object, bounds: Bounds = _ANY) -> LocalFeedbackGain:
    """Return the decoded message.

    Raises:
        InvalidInputError: as :meth:`~hapticmech_ros.wire.bounds.Bounds.stamp`.
    """
    stamp, values = checked_values(data, bounds)
    answered = stamp_of(*values[_ANSWERED].tolist())
    return LocalFeedbackGain(stamp, answered, float(values[_TO_MECHANISM]), values[_MODEL])
