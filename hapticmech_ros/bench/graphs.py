"""The processes of a run: the real graph or the bare one, a recorder, and a probe."""

from __future__ import annotations

import sys
from collections.abc import Mapping
from pathlib import Path

from hapticmech_ros.bench.plan import Step
from hapticmech_ros.graph import Graph, private_environment, ros_arguments, start_process
from hapticmech_ros.nodes.entry import NODES

PROBE = "hapticmech_ros.nodes.bench.graph_probe"
RECORDER = "hapticmech_ros.nodes.recorder"
BARE = "hapticmech_ros.nodes.bench.bare_node"
# The benchmark ends the recorder itself.
FOR_EVER_S = 1e6


class BareGraph(Graph):
    """The bare graph's nodes in the real one's layout; see nodes/bench/bare_node.py."""

    def __init__(self, scene: str, composed: bool, environment: Mapping[str, str]) -> None:
        self.processes = {}
        arguments = ros_arguments({"scene": scene})
        try:
            for group in [",".join(NODES)] if composed else list(NODES):
                command = [sys.executable, "-m", BARE, group, *arguments]
                self.processes[group] = start_process(command, environment)
        except BaseException:
            self.stop()
            raise


def start_graph(step: Step, scene: str, environment: Mapping[str, str]) -> Graph:
    """Start the graph of a step on a scene that has the step's rate."""
    composed = step.configuration.layout == "composed"
    if step.kind == "bare":
        return BareGraph(scene, composed, environment)
    return Graph(scene, composed, environment=environment)


def graph_environment() -> dict[str, str]:
    """Return the environment that all processes of a benchmark share.

    It is what the nodes' entry sets for itself, said for all: a recorder, a probe and the bare
    nodes go the same way.
    """
    environment = private_environment()
    environment.setdefault("OPENBLAS_NUM_THREADS", "1")
    environment.setdefault("FASTDDS_BUILTIN_TRANSPORTS", "UDPv4")
    return environment


def recorder_command(bag: Path, scene: str) -> list[str]:
    """Return the command that records every topic of a graph until a signal ends it.

    It prints a line of JSON with the event ``ready`` once it listens.
    """
    command = [sys.executable, "-m", RECORDER, "--out", str(bag), "--scene", scene]
    return [*command, "--duration", str(FOR_EVER_S), "--start-timeout", str(FOR_EVER_S)]


def probe_command() -> list[str]:
    """Return the command that prints what the nodes say of themselves."""
    return [sys.executable, "-m", PROBE]
