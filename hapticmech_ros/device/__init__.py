"""The simulated impedance device and the hand that holds it."""

from hapticmech_ros.device.build import device_for
from hapticmech_ros.device.driver import NO_WRENCH
from hapticmech_ros.device.grip import Grip, grip_of
from hapticmech_ros.device.hand import HandLaw, hand_law, no_hand
from hapticmech_ros.device.impedance_device import ImpedanceDevice
from hapticmech_ros.device.state import DeviceState

__all__ = [
    "NO_WRENCH",
    "DeviceState",
    "Grip",
    "HandLaw",
    "ImpedanceDevice",
    "device_for",
    "grip_of",
    "hand_law",
    "no_hand",
]
