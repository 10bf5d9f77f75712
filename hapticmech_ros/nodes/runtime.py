# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Makes the graph's nodes and runs them, alone or several in one process."""

from __future__ import annotations

import importlib
import os
import sys
from collections.abc import Sequence
from functools import partial
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import rclpy
from rclpy.exceptions import NameValidationException
from rclpy.executors import ExternalShutdownException
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.logging import get_logger
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.signals import SignalHandlerOptions

from hapticmech_ros.errors import HapticMechError, as_ours
from hapticmech_ros.files import PARAMETER_FILE_LIMIT, check_file
from hapticmech_ros.nodes.exchange import Exchange
from hapticmech_ros.nodes.loop import (
    StopRequest,
    prepare_loops,
    print_line,
    run_each,
    run_until,
    wake_up_in_time,
)
from hapticmech_ros.nodes.realtime import QuickStart, Realtime, Request
from hapticmech_ros.system.discovery import exposure
from hapticmech_ros.system.readiness import SHOWN, report_ready

if TYPE_CHECKING:
    from hapticmech_ros.nodes.actor import Actor
    from hapticmech_ros.nodes.managed import ManagedNode

# Errors of ROS on arguments, names and parameter files, and of the system on files.
REFUSALS = (
    NameValidationException,
    OSError,
    rclpy_implementation.RCLError,
    rclpy_implementation.UnknownROSArgsError,
)
_ACTORS = {
    "haptic_device": (".haptic_device", "HapticDevice"),
    "haply_device": (".haply_device", "HaplyDevice"),
    "relay_device": (".relay_device", "RelayDevice"),
    "mechanism_simulator": (".mechanism_simulator", "MechanismSimulator"),
    "nullspace_analyser": (".nullspace_analyser", "NullspaceAnalyser"),
    "teleoperation_controller": (".teleoperation_controller", "TeleoperationController"),
    "robot_follower": (".robot_follower", "RobotFollower"),
    "simulated_robot": (".simulated_robot", "SimulatedRobot"),
    "scene_viewer": (".viewer.scene_viewer", "SceneViewer"),
    "live_page": (".viewer.live_page", "LivePageNode"),
}


def run(names: Sequence[str], arguments: Sequence[str], starting: QuickStart) -> int:
    """Create the named nodes, run them until a signal, and return the exit code.

    Each runs in a thread of its own; those that follow /clock share one, since Python handles all
    their messages and its lock would change hands with each.

    Args:
        names: of the nodes.
        arguments: for ROS.
        starting: ends when they are made.
    """
    stop = StopRequest()
    wake_up_in_time()
    try:
        _check_parameter_files(arguments)
        rclpy.init(args=list(arguments), signal_handler_options=SignalHandlerOptions.NO)
    except (HapticMechError, *REFUSALS) as error:
        sys.stderr.write(f"{as_ours(error)}\n")
        return 1
    early_node = _early_node()
    exposed = exposure()
    if exposed:
        get_logger("discovery").warning(exposed)
    from hapticmech_ros.nodes.managed import ManagedNode

    nodes: list[ManagedNode] = []
    realtime: Realtime | None = None
    try:
        # One by one: those made before a failure are destroyed.
        for name in names:
            nodes.append(ManagedNode(actor_type(name), Exchange()))
            nodes[-1].start()
        early_node.destroy_node()
        starting.end()
        refusals = {node.exchange.refusal: None for node in nodes if node.exchange.refusal}
        for refusal in refusals:
            get_logger("lane").warning(f"all messages go through the middleware: {refusal}")

        def begin() -> None:
            nonlocal realtime
            realtime = _ask_for_real_time(nodes)
            report_ready()
            prepare_loops()

        run_each(stop, [partial(run_until, stop, *one) for one in _loops(nodes)], begin)
        for node in nodes:
            node.report_status(last=True)
            if SHOWN not in os.environ:
                print_line(node.final_report())
            node.end()
        for node in nodes:
            node.acknowledged()
        return 0
    except (HapticMechError, *REFUSALS) as error:
        sys.stderr.write(f"{as_ours(error)}\n")
        return 1
    except ExternalShutdownException:
        return 0
    finally:
        # First: others then expect no more from this process.
        for node in nodes:
            node.exchange.close()
        for node in nodes:
            node.destroy_node()
        if realtime is not None:
            realtime.close()
        rclpy.try_shutdown()


def _check_parameter_files(arguments: Sequence[str]) -> None:
    """Refuse parameter files that rcl would wait for or read without end.

    Raises:
        FileError: not there, no regular file, or too large.
    """
    for option, path in pairwise(arguments):
        if option == "--params-file":
            check_file(path, PARAMETER_FILE_LIMIT)


def _loops(nodes: Sequence[ManagedNode]) -> list[tuple[list[ManagedNode], Exchange]]:
    """Return the nodes of each loop, and the loop's exchange."""
    followers = [node for node in nodes if node.in_sim_time]
    loops = [([node], node.exchange) for node in nodes if not node.in_sim_time]
    if followers:
        if len(followers) > 1:
            # One that is configured anew, without /clock, must not open a lane: no loop reads it.
            for node in followers:
                node.exchange.refusal = "this process was started with use_sim_time"
        loops.append((followers, followers[0].exchange))
    return loops


def _ask_for_real_time(nodes: Sequence[ManagedNode]) -> Realtime:
    """Request real-time settings for nodes once they are made: importing them was not urgent."""
    in_sim_time = any(node.in_sim_time for node in nodes)
    realtime = Realtime(Request.of([node.parameters for node in nodes], in_sim_time))
    for node in nodes:
        node.realtime = realtime
    for refusal in realtime.refusals:
        get_logger("realtime").info(f"{refusal} (docs/realtime.md)")
    return realtime


def _early_node() -> Node:
    """Return a hidden node, with which the middleware begins to look for the other processes.

    It does so in its own threads and takes half a second, as a node's imports do too. It has no
    services: rclpy leaves that of type descriptions to the middleware when a node ends.
    """
    return rclpy.create_node(
        "_starting",
        use_global_arguments=False,
        enable_rosout=False,
        start_parameter_services=False,
        parameter_overrides=[Parameter("start_type_description_service", value=False)],
    )


def actor_type(name: str) -> type[Actor[Any]]:
    """Return the actor's class for a node's name.

    Only its module is imported: the others' kernels would make a restart a second longer.
    """
    module, kind = _ACTORS[name]
    found: type[Actor[Any]] = getattr(importlib.import_module(module, __package__), kind)
    return found
