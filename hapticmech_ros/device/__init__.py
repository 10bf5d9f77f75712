# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The simulated impedance device and the hand that holds it."""

from hapticmech_ros.device.hand import GraspSchedule, HandLaw, grasp_schedule_of
from hapticmech_ros.device.impedance_device import ImpedanceDevice, device_for
from hapticmech_ros.device.state import NO_WRENCH, DeviceState, SimulatedDevice

__all__ = [
    "NO_WRENCH",
    "DeviceState",
    "GraspSchedule",
    "HandLaw",
    "ImpedanceDevice",
    "SimulatedDevice",
    "device_for",
    "grasp_schedule_of",
]
