# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What a device hears of other users' devices on the same mechanism, and of what they do to it."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from hapticmech_ros.arrays import Array
from hapticmech_ros.control.other_hands import OtherHands, heard_directly
from hapticmech_ros.layout import DEVICE_SAMPLE
from hapticmech_ros.nodes.actor import ClockedActor
from hapticmech_ros.nodes.local_loop import LocalLoop
from hapticmech_ros.wire.coupling_wire import CouplingWire
from hapticmech_ros.wire.layouts import DEVICE_FIELDS, device_bounds
from hapticmech_ros.wire.readings import read_device
from hapticmech_ros.wire.topics import DEVICE_COUPLING, DEVICE_STATE

_FORCE = DEVICE_SAMPLE.slice("hand_wrench")


class OtherUsers:
    """Listens to devices in the namespaces of other points, and to ``device/coupling_gain``.

    Each user's nodes are in a namespace of the point's name, side by side; a device in another one
    hears of nobody.

    Args:
        actor: the device.
    """

    def __init__(self, actor: ClockedActor[Any]) -> None:
        self._actor = actor
        topic = actor.node.resolve_topic_name(DEVICE_STATE.name)
        root, found, _ = topic.rpartition(f"/{actor.point}/{DEVICE_STATE.name}")
        points = actor.other_points if found else []
        names = heard_directly(actor.shared_scene, actor.point, points)
        self._topics = {name: f"{root}/{name}/{DEVICE_STATE.name}" for name in names}
        self._wire = CouplingWire(actor.other_points, actor.limits)

    def begin(self) -> OtherHands | None:
        """Return what will be known of their hands; None if there is nobody to hear of."""
        return OtherHands(self._topics, self._actor.period_ns) if self._topics else None

    def listen(self, loop: Callable[[], LocalLoop]) -> None:
        """Subscribe.

        Args:
            loop: returns what corrects commands now.
        """
        if not self._topics:
            return
        actor, lockstep = self._actor, self._actor.lockstep

        def on_coupling(values: Array, now_ns: int) -> None:
            loop().take_coupling(self._wire.unpack(values), now_ns, lockstep)
            if lockstep:
                actor.act(now_ns)

        qos = actor.control_input
        actor.input_array(DEVICE_COUPLING.name, qos, on_coupling, self._wire.fields)
        for name, topic in self._topics.items():
            actor.input_array(topic, qos, self._hears(name, loop), DEVICE_FIELDS)

    def _hears(self, name: str, loop: Callable[[], LocalLoop]) -> Callable[[Array, int], None]:
        bounds = device_bounds(self._actor.shared_scene.held_at(name).limits)

        def on_state(values: Array, now_ns: int) -> None:
            found, others = read_device(values, bounds), loop().others
            if others is not None:
                others.measured(name, found.measured[_FORCE], found.stamp_ns)
                if self._actor.lockstep:
                    self._actor.act(now_ns)

        return on_state
