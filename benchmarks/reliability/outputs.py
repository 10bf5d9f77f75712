# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What a device's actuators did while somebody sent what nobody should: never more than they may.

Of a device that is at zero all the while this says nothing: how often it had force is counted too.
"""

from __future__ import annotations

import numpy as np

from benchmarks.reliability.fake_graph import applied_in
from benchmarks.reliability.figure import Figure
from hapticmech_ros.scene.device import Device

# Of a device that is to render meanwhile: share of its samples, and of its limit.
LEAST_SHARE, LEAST_FORCE = 0.2, 0.9


class ForceSeen:
    """Looks at samples of ``device/state``.

    Args:
        device: whose limits count.

    Attributes:
        samples: that were looked at.
        pushed: of these, how many had force.
        beyond: how many had more force or torque than the device may give.
        largest: N, of all.
        example: applied wrench of the last one beyond.
    """

    def __init__(self, device: Device) -> None:
        self._limits = device.force_limit * (1 + 1e-9), device.torque_limit * (1 + 1e-9)
        self._force_limit = device.force_limit
        self.samples = self.pushed = self.beyond = 0
        self.largest = 0.0
        self.example = ""

    def look(self, message: bytes) -> None:
        """Look at a sample."""
        applied = applied_in(message)
        force, torque = float(np.linalg.norm(applied[:3])), float(np.linalg.norm(applied[3:]))
        self.samples += 1
        self.pushed += not force <= 0.0
        self.largest = max(self.largest, force)
        if not (force <= self._limits[0] and torque <= self._limits[1]):
            self.beyond += 1
            self.example = str(applied.tolist())

    def figures(self, part: str, where: str, renders: bool) -> list[Figure]:
        """Return what was seen.

        Args:
            part: of the campaign.
            where: the messages were sent.
            renders: the device has to have force meanwhile, up to its limit.
        """
        share = self.pushed / max(self.samples, 1)
        reached = self.largest / self._force_limit
        shares, forces = (LEAST_SHARE, LEAST_FORCE) if renders else (None, None)

        def figure(name: str, value: float, most: float | None, least: float | None) -> Figure:
            return Figure(part, f"{where}: {name}", value, "", most, least, self.samples)

        return [
            figure("samples beyond the force limit", self.beyond, 0.0, None),
            figure("share of samples with force", share, None, shares),
            figure("largest force, of the limit", reached, None, forces),
        ]
