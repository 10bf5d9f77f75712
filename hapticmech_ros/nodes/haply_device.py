# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Driver of a Haply Inverse3, by the JSON of its local service."""

from __future__ import annotations

from hapticmech_ros.device.real_device import RealDevice
from hapticmech_ros.haply.inverse3 import Inverse3
from hapticmech_ros.haply.messages import Link
from hapticmech_ros.nodes.parameters import HaplyParameters
from hapticmech_ros.nodes.real_device_driver import RealDeviceDriver


class HaplyDevice(RealDeviceDriver[HaplyParameters]):
    """Drives an Inverse3: at each deadline one force is commanded and one sample taken."""

    name = "haply_device"
    parameters_type = HaplyParameters

    def new_device(self) -> RealDevice:
        """Return the Inverse3; connecting begins with the first tick."""
        given = self.parameters
        return Inverse3(
            Link(given.uri), self.scene, self.mounting, given.device_id, self.command_timeout
        )
