# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The common part of the nodes of real devices: the device may be absent."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import TypeVar

import numpy as np
import pinocchio as pin

from hapticmech_ros.device.real_device import RealDevice
from hapticmech_ros.device.safety import MotionCheck
from hapticmech_ros.errors import InvalidInputError
from hapticmech_ros.nodes.actor import Host
from hapticmech_ros.nodes.device_driver import DeviceDriver
from hapticmech_ros.nodes.parameters import MountedParameters
from hapticmech_ros.numerics import Array
from hapticmech_ros.scene.holding_rules import pose_without_torques

D = TypeVar("D", bound=MountedParameters)


class RealDeviceDriver(DeviceDriver[D]):
    """Exchanges a command for a sample at each deadline; publishes nothing without the device."""

    device: RealDevice

    def __init__(self, node: Host, parameters: D) -> None:
        if parameters.lockstep:
            raise InvalidInputError("lockstep", True, "must be false: a real device has real time")
        super().__init__(node, parameters)
        self._was_there = False
        self._motion = MotionCheck(self.scene.device, self.period_s)
        if warning := pose_without_torques(self.scene):
            node.get_logger().warning(warning)

    @property
    def mounting(self) -> Array:
        """Axes (3, 3) of the device's base in the world."""
        given = self.parameters
        angles = given.mounting_roll, given.mounting_pitch, given.mounting_yaw
        return np.asarray(pin.rpy.rpyToMatrix(*angles))

    def apply_parameters(self, parameters: D) -> None:
        """Take new parameters: the device's silence counts from now on."""
        super().apply_parameters(parameters)
        self.device.silence = self.command_timeout

    def steps(self, periods: int, deadline_ns: int) -> Iterator[tuple[int, int]]:
        """Yield one step, after any number of periods: a real device cannot catch up."""
        del periods
        yield deadline_ns - self.period_ns - 1, max(deadline_ns, self.now_ns())

    def unavailable(self) -> str:
        """Return why the device gives no force; empty if it does."""
        return self.device.problem or self._motion.fault

    def has_sample(self) -> bool:
        """Return whether the device has answered in this period."""
        return self.device.fresh

    def tick(self, periods: int, deadline_ns: int) -> None:
        """Exchange a command for a sample, and publish it; without a device, look for one."""
        is_there = self.device.look()
        if is_there and not self._was_there:
            # At its present place, and without a force: a hand may have moved it meanwhile.
            self._motion.restart()
            self.activate()
        elif self._was_there and not is_there:
            self._warn(self.device.problem)
            self.put_at_zero()
        self._was_there = is_there
        if is_there:
            super().tick(periods, deadline_ns)
            if self.device.fresh:
                # Before the next command, which is made for this sample.
                self._motion.check(self._sample(), self.now_ns())
        self.buttons.publish(self.device.buttons, deadline_ns)

    def put_at_zero(self) -> None:
        """Put the actuators at zero now."""
        self.device.let_go()
        super().put_at_zero()

    def figures(self, now_ns: int) -> Mapping[str, str]:
        """Return the device's entries for diagnostics."""
        return {**self.device.figures(), "motion_faults": str(self._motion.faults)}

    def close(self) -> None:
        """Leave the device without a wrench."""
        self.device.close()
        super().close()
