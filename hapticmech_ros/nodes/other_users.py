# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A device's inputs from other users' devices on the same mechanism.

Each of these topics must have one publisher. If there are two, neither is used, as the right one is
unknown. Then only the correction is missing: other hands are felt two periods late, as over a
connection. The force is not set to zero, as it is for two publishers of commands or of their
dependence on the device itself: another user's second device must not stop this one.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from std_msgs.msg import Float64MultiArray

from hapticmech_ros.control.other_hands import OtherHands, received_directly
from hapticmech_ros.nodes.actor import Actor, ClockedActor
from hapticmech_ros.nodes.inputs import Latest
from hapticmech_ros.nodes.local_loop import FRESH_NS, LocalLoop
from hapticmech_ros.nodes.messages import check_age
from hapticmech_ros.nodes.plain_messages import Received
from hapticmech_ros.nodes.sources import Sources, first_fault
from hapticmech_ros.numerics import Array
from hapticmech_ros.wire.bounds import Bounds, message_bounds, read
from hapticmech_ros.wire.cdr import FlatArray
from hapticmech_ros.wire.layouts import CouplingMatrices, CouplingWire
from hapticmech_ros.wire.messages import DeviceStateMessage
from hapticmech_ros.wire.topics import DEVICE_COUPLING, DEVICE_STATE, TRANSMISSION


class CouplingGuard:
    """Watches topics, each of which has one publisher.

    Args:
        actor: that subscribes to them.
    """

    def __init__(self, actor: Actor[Any]) -> None:
        self._actor = actor
        self._watched: dict[str, Sources] = {}
        self._warned = False

    def watch(self, topic: str) -> Sources:
        """Return the ``Sources`` of a topic, to be notified of its messages' origins.

        In lockstep it is not looked at: awaited messages are never dropped there.
        """
        sources = self._actor.sources(topic)
        if not self._actor.lockstep:
            self._watched[topic] = sources
        return sources

    def doubtful(self, now_ns: int) -> list[str]:
        """Return the topics that must not be used now, and log when the first of them comes."""
        found = [topic for topic, one in self._watched.items() if one.fault(now_ns)]
        if found and not self._warned:
            text = f"{self.fault(now_ns)}: no correction for other hands"
            self._actor.node.get_logger().warning(text)
        self._warned = bool(found)
        return found

    def fault(self, now_ns: int) -> str:
        """Return a sentence that names two publishers of one topic; empty if there are none."""
        return first_fault(self._watched.values(), now_ns)

    def forget(self) -> None:
        """Forget the publishers."""
        for one in self._watched.values():
            one.forget()


class Transmissions:
    """Listens to ``transmission`` of the controller's point, where there are others.

    Args:
        actor: the controller.
        go_on: called with a stamp (ns), in lockstep, when the message of that time has come.
    """

    def __init__(self, actor: Actor[Any], go_on: Callable[[int], None]) -> None:
        self._actor, self._go_on = actor, go_on
        self._wire = CouplingWire(actor.other_points, actor.limits)
        self._latest: Latest[CouplingMatrices] = Latest()
        # In lockstep, by stamp, ns.
        self._stamped: dict[int, CouplingMatrices] = {}
        self._guard = CouplingGuard(actor)
        if actor.other_points:
            name, qos = TRANSMISSION.of(actor.point), actor.control_input
            sources = self._guard.watch(name)
            actor.input_array(name, qos, self._on_message, self._wire.fields, sources)

    def activate(self) -> None:
        """Forget the last message, and the publishers."""
        self._latest = Latest()
        self._guard.forget()

    def reset(self) -> None:
        """Forget messages of lockstep."""
        self._stamped = {}

    def take(self, stamp_ns: int) -> bool:
        """Let the message of a time (ns) count, in lockstep; return whether it is there."""
        if not self._actor.other_points:
            return True
        if stamp_ns not in self._stamped:
            return False
        self._latest.put(self._stamped.pop(stamp_ns), stamp_ns)
        return True

    def at(self, stamp_ns: int, now_ns: int) -> Mapping[str, Array]:
        """Return Y_ij (6, 6) by operational point; none without exactly one publisher.

        Args:
            stamp_ns: of the device's sample for which they are, ns.
            now_ns: present time, ns.
        """
        if self._guard.doubtful(now_ns):
            self._latest = Latest()
        matrices = self._latest.value
        fresh = matrices is not None and self._latest.fresh(stamp_ns, FRESH_NS)
        return matrices.by_point if matrices is not None and fresh else {}

    def fault(self, now_ns: int) -> str:
        """Return a sentence that names two publishers of one topic; empty if there are none."""
        return self._guard.fault(now_ns)

    def _on_message(self, values: Array, now_ns: int) -> None:
        found = self._wire.unpack(values)
        check_age(found.stamp_ns, now_ns, self._actor.age_limit_ns)
        if self._actor.lockstep:
            self._stamped[found.stamp_ns] = found
            self._go_on(found.stamp_ns)
        else:
            self._latest.put(found, found.stamp_ns)


class OtherUsers:
    """Listens to devices in the namespaces of other points, and to ``device/coupling_gain``.

    Each user's nodes are in a namespace of the point's name, side by side; a device in another one
    receives nothing of others.

    Args:
        actor: the device.

    Attributes:
        places: (k,) where the matrix of each of the k others begins in a ``coupling_gain``'s data.
    """

    def __init__(self, actor: ClockedActor[Any]) -> None:
        self._actor = actor
        topic = actor.node.resolve_topic_name(DEVICE_STATE.name)
        root, found, _ = topic.rpartition(f"/{actor.point}/{DEVICE_STATE.name}")
        points = actor.other_points if found else []
        names = received_directly(actor.shared_scene, actor.point, points)
        self._names = {f"{root}/{name}/{DEVICE_STATE.name}": name for name in names}
        self._wire = CouplingWire(actor.other_points, actor.limits)
        self.places = np.array([self._wire.fields.start(name) for name in names], dtype=np.int64)
        self._guard = CouplingGuard(actor)
        topics = DEVICE_COUPLING.name, *self._names
        self._sources = {topic: self._guard.watch(topic) for topic in topics}

    def begin(self) -> OtherHands:
        """Return the store of their hands' wrenches."""
        self._guard.forget()
        return OtherHands(self._names.values(), self._actor.period_ns)

    def listen(self, loop: Callable[[], LocalLoop]) -> None:
        """Subscribe.

        Args:
            loop: returns the present corrector of commands.
        """
        if not self._names:
            return
        actor, lockstep, sources = self._actor, self._actor.lockstep, self._sources

        def on_coupling(values: Array, now_ns: int) -> None:
            found = self._wire.unpack(values)
            loop().take_coupling(found, now_ns, lockstep, actor.age_limit_ns)
            if lockstep:
                actor.act(now_ns)

        qos, gains = actor.control_input, DEVICE_COUPLING.name
        actor.input_array(gains, qos, on_coupling, self._wire.fields, sources[gains])
        for topic, name in self._names.items():
            actor.input_array(
                topic, qos, self._receives(name, loop), DeviceStateMessage.layout, sources[topic]
            )

    def received(self) -> list[Received]:
        """Return the topics for a kernel, ``coupling_gain`` first; it is there without others."""
        prefix, actor = FlatArray(self._wire.fields).prefix, self._actor
        topic = actor.lane_topic(DEVICE_COUPLING.name, Float64MultiArray) if self._names else ""
        coupling, *states = self._sources.values()
        found = [Received(topic, coupling, prefix, self._wire.bounds.most, beside=True)]
        prefix = FlatArray(DeviceStateMessage.layout).prefix
        for (topic, name), sources in zip(self._names.items(), states, strict=True):
            told, most = actor.lane_topic(topic, Float64MultiArray), self._bounds(name).most
            found.append(Received(told, sources, prefix, most, awaited=False, may_lack=True))
        return found

    def drop_doubtful(self, loop: LocalLoop, now_ns: int) -> bool:
        """Forget inputs that have two publishers now (ns); return whether there are any."""
        found = self._guard.doubtful(now_ns)
        for topic in found:
            if topic == DEVICE_COUPLING.name:
                loop.forget_coupling()
            else:
                loop.others.forget(self._names[topic])
        return bool(found)

    def fault(self, now_ns: int) -> str:
        """Return a sentence that names two publishers of one topic; empty if there are none."""
        return self._guard.fault(now_ns)

    def figures(self, loop: LocalLoop, now_ns: int) -> dict[str, str]:
        """Return entries for diagnostics, where there are other users."""
        if not self._names:
            return {}
        return {
            "coupling_fault": self.fault(now_ns),
            "corrected_for_others": str(loop.others.data.notes.corrected),
            "uncorrected_for_others": str(loop.others.data.notes.uncorrected),
        }

    def _receives(self, name: str, loop: Callable[[], LocalLoop]) -> Callable[[Array, int], None]:
        bounds = self._bounds(name)

        def on_state(values: Array, now_ns: int) -> None:
            found = read(DeviceStateMessage, values, bounds)
            check_age(found.stamp_ns, now_ns, self._actor.age_limit_ns)
            loop().others.measured(name, found.sample.hand_wrench, found.stamp_ns)
            if self._actor.lockstep:
                self._actor.act(now_ns)

        return on_state

    def _bounds(self, name: str) -> Bounds:
        return message_bounds(DeviceStateMessage, self._actor.shared_scene.held_at(name).limits)
