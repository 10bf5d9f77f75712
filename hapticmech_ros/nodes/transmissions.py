# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What other hands do to a controller's point, as its analyser says."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from hapticmech_ros.arrays import Array
from hapticmech_ros.nodes.actor import Actor
from hapticmech_ros.nodes.coupling_guard import CouplingGuard
from hapticmech_ros.nodes.inputs import Latest, Stamped
from hapticmech_ros.nodes.local_loop import FRESH_NS
from hapticmech_ros.nodes.messages import check_age
from hapticmech_ros.wire.coupling_wire import CouplingMatrices, CouplingWire
from hapticmech_ros.wire.topics import TRANSMISSION


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
        self._stamped: Stamped[CouplingMatrices] = Stamped()
        self._guard = CouplingGuard(actor)
        if actor.other_points:
            name, qos = TRANSMISSION.of(actor.point), actor.control_input
            sources = self._guard.watch(name)
            actor.input_array(name, qos, self._on_message, self._wire.fields, sources)

    def activate(self) -> None:
        """Forget the last message, and who spoke."""
        self._latest = Latest()
        self._guard.forget()

    def reseat(self) -> None:
        """Forget what came in lockstep."""
        self._stamped = Stamped()

    def take(self, stamp_ns: int) -> bool:
        """Let the message of a time (ns) count, in lockstep; return whether it is there."""
        if not self._actor.other_points:
            return True
        if not self._stamped.has(stamp_ns):
            return False
        self._latest.put(self._stamped.take(stamp_ns), stamp_ns)
        return True

    def at(self, stamp_ns: int, now_ns: int) -> Mapping[str, Array]:
        """Return Y_ij (6, 6) by operational point; none where nobody, or more than one, says them.

        Args:
            stamp_ns: of the device's sample for which they are, ns.
            now_ns: present time, ns.
        """
        if self._guard.doubtful(now_ns):
            self._latest = Latest()
        told = self._latest.value
        fresh = told is not None and self._latest.fresh(stamp_ns, FRESH_NS)
        return told.by_point if told is not None and fresh else {}

    def fault(self, now_ns: int) -> str:
        """Return which two say what one may; empty if none do."""
        return self._guard.fault(now_ns)

    def _on_message(self, values: Array, now_ns: int) -> None:
        found = self._wire.unpack(values)
        check_age(found.stamp_ns, now_ns, self._actor.age_limit_ns)
        if self._actor.lockstep:
            self._stamped.put(found, found.stamp_ns)
            self._go_on(found.stamp_ns)
        else:
            self._latest.put(found, found.stamp_ns)
