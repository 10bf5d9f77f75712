# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What a device hears of other users' devices on the same mechanism, and of what they do to it.

Each of these topics has one publisher: see :mod:`~hapticmech_ros.nodes.coupling_guard`.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from hapticmech_ros.arrays import Array
from hapticmech_ros.control.other_hands import OtherHands, heard_directly
from hapticmech_ros.layout import DEVICE_SAMPLE
from hapticmech_ros.nodes.actor import ClockedActor
from hapticmech_ros.nodes.coupling_guard import CouplingGuard
from hapticmech_ros.nodes.local_loop import LocalLoop
from hapticmech_ros.nodes.messages import check_age
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
        self._names = {f"{root}/{name}/{DEVICE_STATE.name}": name for name in names}
        self._wire = CouplingWire(actor.other_points, actor.limits)
        self._guard = CouplingGuard(actor)

    def begin(self) -> OtherHands | None:
        """Return what will be known of their hands; None if there is nobody to hear of."""
        self._guard.forget()
        if not self._names:
            return None
        return OtherHands(self._names.values(), self._actor.period_ns)

    def listen(self, loop: Callable[[], LocalLoop]) -> None:
        """Subscribe.

        Args:
            loop: returns what corrects commands now.
        """
        if not self._names:
            return
        actor, lockstep, watch = self._actor, self._actor.lockstep, self._guard.watch

        def on_coupling(values: Array, now_ns: int) -> None:
            found = self._wire.unpack(values)
            loop().take_coupling(found, now_ns, lockstep, actor.age_limit_ns)
            if lockstep:
                actor.act(now_ns)

        qos, gains = actor.control_input, DEVICE_COUPLING.name
        actor.input_array(gains, qos, on_coupling, self._wire.fields, watch(gains))
        for topic, name in self._names.items():
            actor.input_array(topic, qos, self._hears(name, loop), DEVICE_FIELDS, watch(topic))

    def drop_doubtful(self, loop: LocalLoop, now_ns: int) -> None:
        """Forget what must not be used now (ns), since two say it."""
        for topic in self._guard.doubtful(now_ns):
            if topic == DEVICE_COUPLING.name:
                loop.forget_coupling()
            elif loop.others is not None:
                loop.others.forget(self._names[topic])

    def fault(self, now_ns: int) -> str:
        """Return which two say what one may; empty if none do."""
        return self._guard.fault(now_ns)

    def figures(self, loop: LocalLoop, now_ns: int) -> dict[str, str]:
        """Return what diagnostics say, where there are other users."""
        if not self._names:
            return {}
        return {
            "coupling_fault": self.fault(now_ns),
            "corrected_for_others": str(loop.corrected_for_others),
            "uncorrected_for_others": str(loop.uncorrected_for_others),
        }

    def _hears(self, name: str, loop: Callable[[], LocalLoop]) -> Callable[[Array, int], None]:
        bounds = device_bounds(self._actor.shared_scene.held_at(name).limits)

        def on_state(values: Array, now_ns: int) -> None:
            found, others = read_device(values, bounds), loop().others
            check_age(found.stamp_ns, now_ns, self._actor.age_limit_ns)
            if others is not None:
                others.measured(name, found.measured[_FORCE], found.stamp_ns)
                if self._actor.lockstep:
                    self._actor.act(now_ns)

        return on_state
