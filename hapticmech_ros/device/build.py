"""Which implementation of the device runs."""

from __future__ import annotations

from hapticmech_ros.device.grip import grip_of
from hapticmech_ros.device.hand import hand_law
from hapticmech_ros.device.impedance_device import ImpedanceDevice
from hapticmech_ros.scene.document import Scene


def device_for(scene: Scene, with_hand: bool = True, compiled: bool = True) -> ImpedanceDevice:
    """Return the device of a scene.

    Args:
        scene: what to build.
        with_hand: whether the scene's hand may hold it; without, its own wrench is zero.
        compiled: by a kernel, ten times faster, or by the readable implementation that it is
            compared with. Results agree to rounding, not to the bit: take one for all.
    """
    period, planar = scene.simulation.period, scene.task_space == "planar"
    hand = scene.hand if with_hand else None
    if not compiled:
        if hand is None:
            return ImpedanceDevice(scene.device, period, planar)
        return ImpedanceDevice(scene.device, period, planar, hand_law(hand), grip_of(hand))
    # Here, so that only what runs a device waits for Numba.
    from hapticmech_ros.device.compiled import CompiledDevice

    return CompiledDevice(scene.device, period, planar, hand)
