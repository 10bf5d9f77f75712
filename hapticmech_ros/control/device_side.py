# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What a device does with a command before its actuators give it: safety, and passivity."""

from __future__ import annotations

import math

import numpy as np

from hapticmech_ros.arrays import Array
from hapticmech_ros.control.device_side_kernels import allow_command
from hapticmech_ros.control.passivity import NO_WRENCH, PassivityController, passivity_for
from hapticmech_ros.device.safety import SafetyEnvelope, SafetyLimits, safety_limits
from hapticmech_ros.scene import Scene


class DeviceSide:
    """The device's side of the rendering loop, in a session and in the device's node.

    Args:
        scene: whose device.
        limits: of what leaves; the scene's if left out.

    Attributes:
        passivity: the account of its energies.
        envelope: the last before a force leaves.
    """

    def __init__(self, scene: Scene, limits: SafetyLimits | None = None) -> None:
        self.passivity: PassivityController = passivity_for(scene)
        if limits is None:
            limits = safety_limits(scene.device)
        self.envelope = SafetyEnvelope(scene.simulation.period, limits)

    def begin(self) -> None:
        """Start anew: the hand takes hold, or nobody holds."""
        self.passivity.begin()
        self.envelope.stop()

    def allow(
        self,
        command: Array,
        sample: Array,
        applied: Array,
        to_mechanism: float | None,
        added: Array = NO_WRENCH,
    ) -> Array:
        """Account for the last period, and return what leaves (6,) of a command for the next one.

        Args:
            command: (6,) on the hand, by the device, at the point held, N and N m, world axes.
            sample: (19,) of the device now, in SI units; see ``layout.DEVICE_SAMPLE``.
            applied: (6,) by the actuators, taken as held over the period; N and N m, world axes.
            to_mechanism: E_m, J, as it is told; None while nobody tells it.
            added: (6,) by the device's driver, for weight and friction, N and N m, world axes.
        """
        found = np.array(command, dtype=float)
        given = math.nan if to_mechanism is None else to_mechanism
        arrays = self.passivity.account, self.envelope.numbers
        allow_command(*arrays, found, sample, applied, added, given)
        return found
