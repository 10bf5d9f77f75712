"""The simulated impedance device and the hand that holds it."""

from hapticmech_ros.device.hand import HandLaw, hand_law, no_hand
from hapticmech_ros.device.impedance_device import DeviceState, ImpedanceDevice

__all__ = ["DeviceState", "HandLaw", "ImpedanceDevice", "hand_law", "no_hand"]
