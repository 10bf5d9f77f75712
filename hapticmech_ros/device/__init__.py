"""The simulated impedance device and the hand that holds it."""

from hapticmech_ros.device.build import device_for
from hapticmech_ros.device.hand import HandLaw, hand_law, no_hand
from hapticmech_ros.device.impedance_device import NO_WRENCH, ImpedanceDevice
from hapticmech_ros.device.state import DeviceState

__all__ = [
    "NO_WRENCH",
    "DeviceState",
    "HandLaw",
    "ImpedanceDevice",
    "device_for",
    "hand_law",
    "no_hand",
]
