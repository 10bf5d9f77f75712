# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""One run: start a graph, wait until it works, watch it for a window, and say what was seen."""

from __future__ import annotations

import shutil
import sys
import time
from collections.abc import Mapping
from contextlib import ExitStack, suppress
from dataclasses import dataclass, field
from pathlib import Path

import psutil

from benchmarks.children import (
    BenchError,
    ReportingProcess,
    finding_benchmarks,
    output_to,
    wait_until,
)
from benchmarks.graph.checks import ENGAGED, Check, Expected, check_recording, check_run
from benchmarks.graph.plan import VIEW_HZ, Step
from benchmarks.graph.recorded import recorded
from benchmarks.graph.statuses import Figures, Status, around, said, status_of
from hapticmech_ros.errors import HapticMechError
from hapticmech_ros.graph.processes import Graph, private_environment, ros_arguments, start_process
from hapticmech_ros.nodes.entry import NODES
from hapticmech_ros.numerics.times import NANOSECONDS
from hapticmech_ros.system.readiness import Readiness
from hapticmech_ros.wire.topics import CONTROLLER

ENGAGES_WITHIN_S = 30.0
# Between engagement and the window: caches fill, the controller's wrench comes in.
SETTLES_S = 2.0
# Nodes speak once a second; one that is overloaded may be late.
SPEAKS_WITHIN_S = 6.0
# Prints what the nodes say of themselves.
PROBE = [sys.executable, "-m", "benchmarks.graph.graph_probe"]
BARE = [sys.executable, "-m", "benchmarks.graph.bare_node"]
# Records every topic until it is ended; tells ``ready`` once it listens.
RECORDER = [
    *(sys.executable, "-m", "hapticmech_ros.nodes.recorder"),
    *("--duration", "1e6", "--start-timeout", "1e6"),
]
# Name of a figure: processor time that the host of a virtual machine gave to others.
STOLEN = "stolen by the host, %"


@dataclass(frozen=True, slots=True)
class Run:
    """What was seen of one run.

    Attributes:
        step: what was run.
        failure: why there is nothing to see; empty if there is.
        checks: what had to hold.
        figures: what was measured in the window, by what it is and its unit.
        sizes: bytes of the smallest message in the bag, by topic; none without a recorder.
    """

    step: Step
    failure: str = ""
    checks: tuple[Check, ...] = ()
    figures: Figures = field(default_factory=dict)
    sizes: Mapping[str, int] = field(default_factory=dict)

    @property
    def faults(self) -> list[str]:
        """Why there is nothing to see, or which checks did not hold."""
        if self.failure:
            return [self.failure]
        return [f"{check.rule}: {check.seen}" for check in self.checks if not check.held]

    @property
    def sound(self) -> bool:
        """Whether there is something to see, and all checks held."""
        return not self.faults


def processor_share(process: str) -> str:
    """Return the name of a figure: the processor time that a process takes."""
    return f"CPU of {process}, % of one core"


def load_since(processes: Mapping[str, psutil.Process]) -> Figures:
    """Return the processor time that was taken since the last call; not of what has ended."""
    found = {STOLEN: psutil.cpu_times_percent().steal}
    for name, process in processes.items():
        with suppress(psutil.NoSuchProcess):
            found[processor_share(name)] = process.cpu_percent()
    return found


def measure(
    step: Step, scene: Path, point: str, seconds: float, folder: Path, session: Expected
) -> Run:
    """Carry out one run; a graph that does not work is a result too, told in ``failure``.

    Args:
        step: what to run.
        scene: scene at the step's rate.
        point: operational point that is held.
        seconds: length of the window.
        folder: for the nodes' output, and a bag that is removed again.
        session: what the real graph should do.
    """
    bag = folder / "bag"
    shutil.rmtree(bag, ignore_errors=True)
    try:
        return _run(step, str(scene), point, seconds, folder, bag, session)
    except HapticMechError as error:
        return Run(step, failure=str(error))
    finally:
        shutil.rmtree(bag, ignore_errors=True)


def _run(
    step: Step, scene: str, point: str, seconds: float, folder: Path, bag: Path, session: Expected
) -> Run:
    environment = graph_environment()
    with ExitStack() as stack:
        with output_to(folder / "nodes.log"):
            probe = stack.enter_context(ReportingProcess(PROBE, environment))
            started = {"probe": probe.process}
            if step.configuration.recorded:
                command = [*RECORDER, "--out", str(bag), "--scene", scene]
                recorder = stack.enter_context(ReportingProcess(command, environment))
                started["recorder"] = recorder.process
            graph = stack.enter_context(start_graph(step, scene, environment))
        # A process of several nodes is called ``composed``.
        processes = {
            "composed" if "," in name else name: psutil.Process(process.pid)
            for name, process in {**graph.processes, **started}.items()
        }
        wait_until_engaged(graph, probe)
        begun_ns = time.time_ns()
        load_since(processes)
        _wait(graph, seconds)
        load, ended_ns = load_since(processes), time.time_ns()
        wait_until(
            lambda: set(NODES) <= {s.node for s in _statuses(probe) if s.stamp_ns >= ended_ns},
            SPEAKS_WITHIN_S,
            "every node's figures after the window",
            graph.check,
        )
        statuses = _statuses(probe)
    window = (begun_ns, ended_ns)
    ends = {node: around(statuses, node, window) for node in NODES}
    within = [
        status
        for status in statuses
        if status.node in ends
        and ends[status.node][0].stamp_ns <= status.stamp_ns <= ends[status.node][1].stamp_ns
    ]
    figures, checks = said(ends), check_run(step.kind, ends, within, session)
    if not step.configuration.recorded:
        return Run(step, "", checks, {**figures, **load})
    found = recorded(bag, point, window)
    heard = check_recording(found, figures, (ended_ns - begun_ns) / NANOSECONDS, point)
    return Run(step, "", (*checks, heard), {**figures, **found.figures, **load}, found.sizes)


def wait_until_engaged(graph: Graph, probe: ReportingProcess) -> None:
    """Wait until every node works, and a little longer.

    Raises:
        BenchError: it does not come to that in 30 s; says what the nodes say.
        NodeDiedError: a node has ended.
    """

    def last() -> dict[str, str]:
        return {status.node: status.message for status in _statuses(probe)}

    def engaged() -> bool:
        return set(NODES) <= set(last()) and last()[CONTROLLER] == ENGAGED

    try:
        wait_until(engaged, ENGAGES_WITHIN_S, "the graph to engage", graph.check)
    except BenchError as error:
        said_last = "; ".join(f"{node}: {message}" for node, message in sorted(last().items()))
        raise BenchError(f"{error} ({said_last or 'no node spoke'})") from None
    _wait(graph, SETTLES_S)


def _wait(graph: Graph, seconds: float) -> None:
    end = time.monotonic() + seconds
    while (left := end - time.monotonic()) > 0.0:
        graph.check()
        time.sleep(min(left, 0.5))


def _statuses(probe: ReportingProcess) -> list[Status]:
    return [status_of(event) for event in probe.of("status")]


class BareGraph(Graph):
    """The bare graph's nodes in the real one's layout; see bare_node.py."""

    def __init__(
        self, scene: str, composed: bool, environment: Mapping[str, str], view_hz: float = VIEW_HZ
    ) -> None:
        self.processes = {}
        self._readiness = Readiness()
        arguments = ros_arguments({"scene": scene, "view_rate": view_hz})
        for group in [",".join(NODES)] if composed else list(NODES):
            self.processes[group] = start_process([*BARE, group, *arguments], environment)


def start_graph(step: Step, scene: str, environment: Mapping[str, str]) -> Graph:
    """Start the graph of a step on a scene that has the step's rate."""
    chosen = step.configuration
    composed = chosen.layout == "composed"
    if step.kind == "bare":
        return BareGraph(scene, composed, environment, chosen.view_hz)
    parameters: dict[str, object] = {"transport": chosen.transport, "view_rate": chosen.view_hz}
    parameters.update(chosen.settings)
    return Graph(scene, composed, parameters=parameters, environment=environment)


def graph_environment() -> dict[str, str]:
    """Return the environment that all processes of a benchmark share.

    It is what the nodes' entry sets for itself, said for all: a recorder, a probe and the bare
    nodes go the same way.
    """
    environment = finding_benchmarks(private_environment())
    environment.setdefault("OPENBLAS_NUM_THREADS", "1")
    environment.setdefault("FASTDDS_BUILTIN_TRANSPORTS", "UDPv4")
    return environment
