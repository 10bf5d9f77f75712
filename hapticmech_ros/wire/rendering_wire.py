"""Writing ``rendering`` messages in place, at the control rate."""

from __future__ import annotations

import numpy as np

from hapticmech_ros.mechanism.model import Array
from hapticmech_ros.operational import Analyser
from hapticmech_ros.wire.layouts import COMMANDED, GRASP, RENDERING_FIELDS
from hapticmech_ros.wire.stamps import seconds_of
from hapticmech_ros.wire.state import WireState

_START = dict(
    zip(RENDERING_FIELDS, np.cumsum([0, *RENDERING_FIELDS.values()]).tolist(), strict=False)
)


class RenderingWriter:
    """A ``rendering`` message's data, written anew for each state of the mechanism.

    What :func:`~hapticmech_ros.wire.layouts.pack_rendering` returns, without the objects between.

    Attributes:
        values: (151,) the data.
        s: (t,) singular values of the state seen last; a view.
    """

    def __init__(self, analyser: Analyser) -> None:
        self._analyser = analyser
        self._index = analyser.index
        self.values: Array = np.zeros(sum(RENDERING_FIELDS.values()))
        first, contact = _START["s"], _START["contact"]
        directions = analyser.rows.size
        self.values[_START["directions"]] = directions
        self.s: Array = self.values[first : first + directions]
        self._seen = self.values[first:contact]
        self._contact = self.values[contact : contact + RENDERING_FIELDS["contact"]]

    def see(self, state: WireState) -> None:
        """Write all but the count.

        Raises:
            HapticMechError: the state cannot be analysed.
        """
        self._analyser.see(state.q, state.v, state.active, self._seen)
        values = self.values
        values[0], values[1] = seconds_of(state.stamp_ns)
        self._contact[:] = state.contacts[self._index]
        values[COMMANDED] = state.commanded[self._index]
        values[GRASP] = state.grasps[self._index]

    def count(self, count: int) -> None:
        """Write the number of joint constraints reported."""
        self.values[_START["count"]] = count
