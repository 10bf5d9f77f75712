# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A device with Coulomb friction, which its encoders' steps need if nothing is to hum."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from hapticmech_ros.arrays import Array
from hapticmech_ros.device import NO_WRENCH, DeviceState
from hapticmech_ros.errors import InvalidInputError
from hapticmech_ros.scene import Scene
from oracles.device.impedance_device import ReadableDevice


class RoughDevice(ReadableDevice):
    """A scene's device with Coulomb friction along x, y and z, held by nobody.

        Λ_d ẍ = F_o + u - D ẋ - f,      |f_i| ≤ f_c, against the motion, or what it takes to stick

    Args:
        scene: whose device.
        friction: f_c, N, along each axis; nothing turns it back.

    Raises:
        InvalidInputError: friction below 0.
    """

    def __init__(self, scene: Scene, friction: float) -> None:
        if not (np.isfinite(friction) and friction >= 0.0):
            raise InvalidInputError("Coulomb friction", friction, "must be 0 or more")
        super().__init__(scene.device, scene.simulation.period, scene.task_space == "planar")
        self._stops = self._gain * np.array([friction] * 3 + [0.0] * 3)

    def step(
        self,
        state: DeviceState,
        command: Array,
        held: DeviceState | None,
        ticks: int,
        push: Array = NO_WRENCH,
    ) -> DeviceState:
        """Advance one period; see :meth:`ReadableDevice.step`."""
        smooth = super().step(state, command, None, ticks, push)
        pose, twist = state.pose, state.twist
        for _ in range(self.device.substeps):
            force = push + smooth.applied - self._damping * twist
            twist = twist + self._gain * force
            # Friction takes what speed it can in a step, and no more than there is.
            twist = np.sign(twist) * np.maximum(np.abs(twist) - self._stops, 0.0)
            turned = pin.exp3(self._step * twist[3:]) @ pose.rotation
            pose = pin.SE3(turned, pose.translation + self._step * twist[:3])
        measured = self._quantised(pose)
        seen = twist if self._ideal else self._estimated(state, measured)
        return smooth.replaced(pose=pose, twist=twist, measured_pose=measured, measured_twist=seen)
