# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Listens to a device where the device is: every sample's force, its energies, its diagnostics.

    python -m benchmarks.reliability.device_watch FILE [NAMESPACE]

Prints a line once the device is heard and one once it renders, and writes FILE (NumPy, .npz) when
it is told to end.
"""

from __future__ import annotations

import sys
import time
from pathlib import Path

import numpy as np
import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.experimental import EventsExecutor
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.signals import SignalHandlerOptions
from std_msgs.msg import Float64MultiArray

from hapticmech_ros.nodes.loop import StopRequest
from hapticmech_ros.wire.cdr import FlatArray
from hapticmech_ros.wire.messages import DeviceEnergy, DeviceStateMessage

QOS = QoSProfile(depth=2000, reliability=ReliabilityPolicy.RELIABLE)


def watch(file: Path, namespace: str = "") -> None:
    """Listen until a signal.

    Args:
        file: to write.
        namespace: of the device, as of one of several users; empty: none.
    """
    root = f"{namespace}/" if namespace else ""
    stop = StopRequest()
    rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
    node = rclpy.create_node(f"{namespace}_device_watch".strip("_"))
    states: list[bytes] = []
    arrivals: list[int] = []
    energies: list[bytes] = []
    said: dict[str, str] = {}

    def on_state(message: bytes) -> None:
        if not states:
            print("heard", flush=True)
        states.append(message)
        arrivals.append(time.time_ns())

    def on_diagnostics(message: DiagnosticArray) -> None:
        for status in message.status:
            said[status.name] = "; ".join(
                [status.message, *(f"{pair.key} {pair.value}" for pair in status.values)]
            )
            if status.name == f"{root}haptic_device" and status.message == "rendering":
                print("rendering", flush=True)

    for topic, receive in (("state", on_state), ("energy", energies.append)):
        node.create_subscription(Float64MultiArray, f"{root}device/{topic}", receive, QOS, raw=True)
    node.create_subscription(DiagnosticArray, "/diagnostics", on_diagnostics, QOS)
    executor = EventsExecutor()
    executor.add_node(node)
    while not stop.asked:
        executor.spin_once(timeout_sec=0.1)
    np.savez(
        file,
        states=FlatArray(DeviceStateMessage.layout).decode_all(states),
        arrivals=np.array(arrivals),
        energies=FlatArray(DeviceEnergy.layout).decode_all(energies),
        said=np.array([f"{name}: {text}" for name, text in said.items()]),
    )
    node.destroy_node()
    rclpy.try_shutdown()


if __name__ == "__main__":
    watch(Path(sys.argv[1]), *sys.argv[2:])
