# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Simulated haptic device driver: what a real device's ROS driver would be, with a hand on it."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from std_srvs.srv import Trigger

from hapticmech_ros.arrays import Array
from hapticmech_ros.device import NO_WRENCH, SimulatedDevice, device_for
from hapticmech_ros.errors import HapticMechError
from hapticmech_ros.nodes.device_driver import DeviceDriver
from hapticmech_ros.nodes.hand_wrenches import HandWrenches
from hapticmech_ros.nodes.host import Host
from hapticmech_ros.nodes.parameters import DeviceParameters
from hapticmech_ros.scene.hand import STILL_HAND
from hapticmech_ros.wire.topics import START_HAND


class HapticDevice(DeviceDriver[DeviceParameters]):
    """Drives an :class:`~hapticmech_ros.device.ImpedanceDevice`.

    The hand takes hold when commands arrive and lets go when they stop. In lockstep it holds from
    the start, and the command that acts over a period answers the sample one period before it.
    """

    name = "haptic_device"
    parameters_type = DeviceParameters

    def __init__(self, node: Host, parameters: DeviceParameters) -> None:
        self._hand: HandWrenches | None = None
        self._wait_for_start = parameters.wait_for_start
        super().__init__(node, parameters)
        node.keep(node.create_service(Trigger, START_HAND, self._on_start_hand))
        self._hand = HandWrenches(self, lambda: np.asarray(self._state.pose.rotation), self.act)

    def new_device(self) -> SimulatedDevice:
        """Return the scene's device, in the hand that the parameters choose."""
        scene, hand = self.scene, self.parameters.hand
        if hand == "still":
            scene = scene.model_copy(update={"hand": STILL_HAND})
        return device_for(scene, with_hand=hand != "commanded")

    def pushed(self, deadline_ns: int) -> Array:
        """Return what others push with (6,), by topics, N and N m, world axes at the point held."""
        return NO_WRENCH if self._hand is None else self._hand.at(deadline_ns)

    def apply_parameters(self, parameters: DeviceParameters) -> None:
        """Take new parameters: the timeouts count from now on."""
        super().apply_parameters(parameters)
        if self._hand is not None:
            self._hand.apply_parameters(parameters)

    def activate(self) -> None:
        """Begin where the device is, held by nobody; in lockstep, held from the start."""
        if self._hand is not None:
            self._hand.forget()
        super().activate()

    def take_hold(self) -> None:
        """Let the hand take hold, unless it has, or waits."""
        if not self._wait_for_start:
            super().take_hold()

    def ready(self, deadline_ns: int) -> bool:
        """Return whether the command to act on, and the hand's wrench if awaited, are there."""
        heard = self._hand is not None and self._hand.ready(deadline_ns)
        return heard and super().ready(deadline_ns)

    def figures(self, now_ns: int) -> Mapping[str, str]:
        """Return what holds the device, and who pushes, for diagnostics."""
        pushes = {} if self._hand is None else self._hand.figures(now_ns)
        return {"hand": self.parameters.hand, **pushes}

    def _on_start_hand(
        self, request: Trigger.Request, response: Trigger.Response
    ) -> Trigger.Response:
        del request
        return self.failures.answer(START_HAND, self._start_hand, response, "the hand starts")

    def _start_hand(self) -> None:
        if not self._wait_for_start:
            raise HapticMechError("the hand was not waiting")
        self._wait_for_start = False
