# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Executables of the package, for `ros2 run hapticmech_ros <name>` and `bin/<name>`.

Arguments are read before rclpy is imported: `--help` and a missing rclpy are answered at once.
"""

from __future__ import annotations

import gc
import importlib
import os
import sys
from collections.abc import Sequence

from hapticmech_ros.errors import HapticMechError
from hapticmech_ros.nodes.realtime import QuickStart
from hapticmech_ros.system.discovery import choose_discovery
from hapticmech_ros.system.installation import OF_COMMANDS, refuse_unmet, refuse_without_ros
from hapticmech_ros.wire.topics import DEVICE, FOLLOWER, HAPLY, PAGE, RELAY, ROBOT, VIEWER

NODES = {
    "haptic_device": "simulated impedance-type haptic device and the hand that holds it",
    "mechanism_simulator": "the virtual mechanism, moving under wrenches at its operational points",
    "nullspace_analyser": "Λ_h⁻¹, its spectrum and its null space, at the mechanism's state",
    "teleoperation_controller": "impedance, joint-constraint and four-channel controllers (Fig. 3)",
}
# Drivers of devices by their names in the command line; in haptic_device's place.
DRIVERS = {"simulated": DEVICE, "haply": HAPLY, "relay": RELAY}
# These look on; they are not part of the graph.
PURPOSES = {
    **NODES,
    HAPLY: "driver of a Haply Inverse3, through Haply's Inverse service",
    RELAY: "relay to a driver of ros2_control, such as forcedimension_ros2",
    FOLLOWER: "a robot behind ros2_control that follows an operational point of the mechanism",
    ROBOT: "a robot in MuJoCo behind the topics of ros2_control; its scene is the robot",
    VIEWER: "markers, frames and a URDF model of a running graph, for people",
    PAGE: "a running graph in a browser, where it is dragged with the mouse",
}
USAGE = """usage: {name} [--ros-args -p scene:=SCENE -p NAME:=VALUE -r FROM:=TO ...]

{purpose}.

SCENE is the name of a shipped scene ({scenes})
or a YAML file. Topics, parameters and their meaning: docs/topics.md and
`ros2 param describe /{name} NAME`.
"""


def start(names: Sequence[str], arguments: Sequence[str] | None = None) -> int:
    """Run nodes of :data:`NODES` in this process until a signal ends them; return the exit code."""
    arguments = sys.argv[1:] if arguments is None else list(arguments)
    title = names[0] if len(names) == 1 else "composed"
    if any(argument in ("-h", "--help") for argument in arguments):
        from hapticmech_ros.loading import shipped_scenes

        purpose = "; ".join(PURPOSES[name] for name in names)
        scenes = ", ".join(shipped_scenes())
        print(USAGE.format(name=title, purpose=purpose, scenes=scenes))
        return 0
    try:
        refuse_unmet(without=OF_COMMANDS)
        refuse_without_ros(os.environ)
    except HapticMechError as error:
        sys.stderr.write(f"{title}: {error}\n")
        return 1
    # Until all is loaded, there is nothing to collect; prepare_loops() enables it again.
    gc.disable()
    # Matrices are small and cores few: more BLAS threads only add delays. Read when numpy loads.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    # The search for plugins of pydantic, which are not used, takes a node 40 ms.
    os.environ.setdefault("PYDANTIC_DISABLE_PLUGINS", "__all__")
    choose_discovery(os.environ)
    # Viewers may start late.
    starting = QuickStart(["realtime:=off"] if list(names) in ([VIEWER], [PAGE]) else arguments)
    try:
        runtime = importlib.import_module("hapticmech_ros.nodes.runtime")
        return int(runtime.run(names, arguments, starting))
    except HapticMechError as error:
        # The first import of kernels loads, or compiles, them.
        sys.stderr.write(f"{error}\n")
        return 1
    finally:
        gc.enable()


def haptic_device() -> None:
    """Run the haptic device alone."""
    sys.exit(start(["haptic_device"]))


def haply_device() -> None:
    """Run the driver of a Haply Inverse3 alone."""
    sys.exit(start(["haply_device"]))


def relay_device() -> None:
    """Run the relay to a driver of ros2_control alone."""
    sys.exit(start(["relay_device"]))


def mechanism_simulator() -> None:
    """Run the mechanism simulator alone."""
    sys.exit(start(["mechanism_simulator"]))


def nullspace_analyser() -> None:
    """Run the null-space analyser alone."""
    sys.exit(start(["nullspace_analyser"]))


def teleoperation_controller() -> None:
    """Run the teleoperation controller alone."""
    sys.exit(start(["teleoperation_controller"]))


def robot_follower() -> None:
    """Run the robot that follows alone."""
    sys.exit(start([FOLLOWER]))


def simulated_robot() -> None:
    """Run the robot in MuJoCo alone."""
    sys.exit(start([ROBOT]))


def scene_viewer() -> None:
    """Run the scene viewer alone."""
    sys.exit(start([VIEWER]))


def live_page() -> None:
    """Run the live page alone."""
    sys.exit(start([PAGE]))


def composed() -> None:
    """Run the four nodes in one process."""
    sys.exit(start(list(NODES)))


if __name__ == "__main__":
    # python -m hapticmech_ros.nodes.entry NAME[,NAME...] [--ros-args ...]
    sys.exit(start(sys.argv[1].split(","), sys.argv[2:]))
