# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Listens to a device where the device is: every sample's force, its energies, its diagnostics.

    python -m benchmarks.reliability.device_watch FILE [NAMESPACE]

Tells ``rendering`` with all diagnostics that say so, and writes FILE (NumPy, .npz) at its end.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from std_msgs.msg import Float64MultiArray

from benchmarks.watching import watch
from hapticmech_ros.nodes.loop import write_progress
from hapticmech_ros.wire.cdr import FlatArray
from hapticmech_ros.wire.messages import DeviceEnergy, DeviceStateMessage

QOS = QoSProfile(depth=2000, reliability=ReliabilityPolicy.RELIABLE)


class DeviceWatch(Node):
    """Keeps what a device says.

    Args:
        file: to write.
        namespace: of the device, as of one of several users; empty: none.
    """

    def __init__(self, file: Path, namespace: str = "") -> None:
        super().__init__(f"{namespace}_device_watch".strip("_"))
        root = f"{namespace}/" if namespace else ""
        self._file, self._device = file, f"{root}haptic_device"
        self._states: list[bytes] = []
        self._energies: list[bytes] = []
        self._said: dict[str, str] = {}
        for topic, received in (("state", self._states), ("energy", self._energies)):
            name = f"{root}device/{topic}"
            self.create_subscription(Float64MultiArray, name, received.append, QOS, raw=True)
        self.create_subscription(DiagnosticArray, "/diagnostics", self._on_diagnostics, QOS)

    def _on_diagnostics(self, message: DiagnosticArray) -> None:
        for status in message.status:
            figures = (f"{pair.key} {pair.value}" for pair in status.values)
            self._said[status.name] = "; ".join([status.message, *figures])
            if status.name == self._device and status.message == "rendering":
                write_progress("rendering")

    def destroy_node(self) -> None:
        """Write the file, as the last thing."""
        np.savez(
            self._file,
            states=FlatArray(DeviceStateMessage.layout).decode_all(self._states),
            energies=FlatArray(DeviceEnergy.layout).decode_all(self._energies),
            said=np.array([f"{name}: {text}" for name, text in self._said.items()]),
        )
        super().destroy_node()


if __name__ == "__main__":
    sys.exit(watch(lambda: DeviceWatch(Path(sys.argv[1]), *sys.argv[2:]), []))
