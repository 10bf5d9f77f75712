# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The device of a scene."""

from __future__ import annotations

from hapticmech_ros.device.hand import HandLaw
from hapticmech_ros.device.impedance_device import ImpedanceDevice
from hapticmech_ros.scene import Scene


def device_for(scene: Scene, with_hand: bool = True, law: HandLaw | None = None) -> ImpedanceDevice:
    """Return the device of a scene.

    Args:
        scene: what to build.
        with_hand: whether the scene's hand may hold it; without, its own wrench is zero.
        law: of a hand of one's own, which holds when the scene's would, with its mass.
    """
    period, planar = scene.simulation.period, scene.task_space == "planar"
    return ImpedanceDevice(scene.device, period, planar, scene.hand if with_hand else None, law)
