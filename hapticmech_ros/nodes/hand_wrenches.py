# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What others add to the hand's wrench on a device: pushes, or in lockstep one for each sample."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from hapticmech_ros.arrays import Array
from hapticmech_ros.device import NO_WRENCH
from hapticmech_ros.nodes.actor import Actor
from hapticmech_ros.nodes.external_wrenches import ExternalWrenches
from hapticmech_ros.nodes.inputs import Stamped
from hapticmech_ros.nodes.parameters import DeviceParameters
from hapticmech_ros.times import nanoseconds
from hapticmech_ros.wire.topics import HAND_WRENCH


class HandWrenches:
    """Listens to ``device/hand_cf``, ``device/hand_cf/persistent``, and names below these.

    Args:
        actor: the device.
        rotation: returns the device's orientation (3, 3) in the world.
        go_on: called when something came that a tick in lockstep may have waited for.
    """

    def __init__(
        self,
        actor: Actor[DeviceParameters],
        rotation: Callable[[], Array],
        go_on: Callable[[int], None],
    ) -> None:
        self._rotation = rotation
        self._go_on = go_on
        self._external: ExternalWrenches | None = None
        self._awaited: Stamped[Array] = Stamped()
        if actor.lockstep and actor.parameters.hand == "commanded":
            qos = actor.control_input
            actor.input_command(HAND_WRENCH.name, qos, self._on_awaited, unstamped_is_now=False)
            return
        self._external = ExternalWrenches(
            actor, {"hand": "device"}, "hand_cf", ["device", "device_world"]
        )
        self._external.listen(HAND_WRENCH.name)
        self.apply_parameters(actor.parameters)

    def apply_parameters(self, parameters: DeviceParameters) -> None:
        """Take new parameters."""
        if self._external is not None:
            self._external.set_timeout(nanoseconds(parameters.hand_timeout))

    def forget(self) -> None:
        """Drop what was heard."""
        if self._external is not None:
            self._external.forget()

    def ready(self, deadline_ns: int) -> bool:
        """Return whether what a tick in lockstep needs is there."""
        return self._external is not None or self._awaited.has(deadline_ns)

    def at(self, now_ns: int) -> Array:
        """Return the wrench (6,) from now on, N and N m, axes of the world."""
        if self._external is None:
            return self._awaited.take(now_ns)
        return self._external.at(now_ns, self._rotation_of).get("hand", NO_WRENCH)

    def pushes(self, now_ns: int) -> bool:
        """Return whether any wrench stands at a time, ns, or one is awaited."""
        return self._external is None or self._external.pushes(now_ns)

    def figures(self, now_ns: int) -> dict[str, str]:
        """Return who pushes now, for diagnostics."""
        return {} if self._external is None else self._external.figures(now_ns)

    def _rotation_of(self, frame: str) -> Array:
        return np.eye(3) if frame == "device_world" else self._rotation()

    def _on_awaited(self, wrench: Array, stamp_ns: int, now_ns: int) -> None:
        self._awaited.put(wrench, stamp_ns)
        self._go_on(now_ns)
