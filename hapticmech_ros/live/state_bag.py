# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What a session went through as a bag: ``mechanism/state`` at every tick, as the nodes send it."""

from __future__ import annotations

from hapticmech_ros.arrays import Array
from hapticmech_ros.bag import BagWriter
from hapticmech_ros.mechanism import Mechanism
from hapticmech_ros.mechanism.closures import Active
from hapticmech_ros.mechanism.grasp import flat_grasps
from hapticmech_ros.times import nanoseconds
from hapticmech_ros.wire.cdr import FlatArray
from hapticmech_ros.wire.state import StateLayout, WireState
from hapticmech_ros.wire.topics import STATE

_NAME = f"/{STATE.name}"


class StateBag:
    """A bag that is being written.

    Args:
        folder: to make.
        mechanism: whose states they are.

    Raises:
        BagError: as of :class:`~hapticmech_ros.bag.writer.BagWriter`.
    """

    def __init__(self, folder: str, mechanism: Mechanism) -> None:
        self.folder = folder
        self._mechanism = mechanism
        self._layout = StateLayout(mechanism)
        self._messages = FlatArray(self._layout.fields, self._layout.bounds)
        self._writer = BagWriter(folder)
        self._writer.add_topic(_NAME, STATE.type, STATE.qos)

    def add(self, time: float, q: Array, v: Array, active: Active, contacts: Array) -> None:
        """Add a state.

        Args:
            time: of the session, s.
            q: (nq,) configuration.
            v: (nv,) rates.
            active: per closure, whether it is closed.
            contacts: (points, 6) F_c at every operational point, N and N m, world axes.

        Raises:
            BagError: it cannot be written.
            OutputError: numbers beyond the limits of the scene.
        """
        stamp_ns, scene = nanoseconds(time), self._mechanism.scene
        commanded = (True,) * len(scene.operational_points)
        state = WireState(stamp_ns, active, q, v, contacts, flat_grasps(scene), commanded)
        data = self._messages.encode(self._layout.pack(state))
        self._writer.write(_NAME, stamp_ns, data)

    def close(self) -> None:
        """Write what is left."""
        self._writer.close()
