"""How a command depends on the device: loops that are closed in the device itself.

    u = u' + G (F_h - F_h') - K ξ - B (v - v'),      K = k P_c,   B = b P_c

is the controllers' answer to the device as it is now, found from their answer u' to a sample some
time ago, ξ the displacement since then. G closes the force channel, K and B the joint-constraint
controller: along constrained directions the operational point stays where it is, so that nothing
but the device's own motion is missing in an answer that is late. Both are exact for any delay, as
long as X has not changed in it and no limit is met.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from hapticmech_ros.arrays import Array

_NOTHING = np.zeros((6, 6))
_NOTHING.flags.writeable = False


class LocalModel(NamedTuple):
    """How a command depends on the device, (6, 6) each, world axes.

    Attributes:
        force: G, N and N m of the device per N and N m of the hand.
        stiffness: K, N/m, N, N, N m/rad.
        damping: B, N s/m, N s, N s, N m s/rad.
    """

    force: Array
    stiffness: Array
    damping: Array

    @property
    def numbers(self) -> Array:
        """All of it (108,), row by row."""
        return np.concatenate(self).ravel()


NO_MODEL = LocalModel(_NOTHING, _NOTHING, _NOTHING)
