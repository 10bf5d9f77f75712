# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""One run: start a graph, wait until it works, watch it for a window, and say what was seen."""

from __future__ import annotations

import shutil
import sys
import time
from collections.abc import Mapping
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path

from benchmarks.children import (
    BenchError,
    ReportingProcess,
    finding_benchmarks,
    ids,
    output_to,
    wait_until,
)
from benchmarks.graph.checks import ENGAGED, Check, Expected, check_recording, check_run
from benchmarks.graph.plan import VIEW_HZ, Step
from benchmarks.graph.recorded import Recorded, recorded
from benchmarks.graph.statuses import (
    ANSWERS,
    Clocked,
    Percentiles,
    Status,
    around,
    clocked,
    rate_hz,
    said,
    status_of,
)
from benchmarks.machine import MachineLoad, Usage, load_between, usage
from hapticmech_ros.errors import HapticMechError
from hapticmech_ros.graph import Graph, private_environment, ros_arguments, start_process
from hapticmech_ros.nodes.entry import NODES
from hapticmech_ros.numerics.times import NANOSECONDS
from hapticmech_ros.system.readiness import Readiness
from hapticmech_ros.wire.topics import CONTROLLER, DEVICE, MECHANISM

ENGAGES_WITHIN_S = 30.0
# Between engagement and the window: caches fill, the controller's wrench comes in.
SETTLES_S = 2.0
# Nodes speak once a second; one that is overloaded may be late.
SPEAKS_WITHIN_S = 6.0
PROBE = "benchmarks.graph.graph_probe"
RECORDER = "hapticmech_ros.nodes.recorder"
BARE = "benchmarks.graph.bare_node"
# The benchmark ends the recorder itself.
FOR_EVER_S = 1e6


@dataclass(frozen=True, slots=True)
class Run:
    """What was seen of one run.

    Attributes:
        step: what was run.
        failure: why there is nothing to see; empty if there is.
        window_s: length of the window.
        checks: what had to hold.
        clocked: device and mechanism, how they kept their deadlines.
        answers_hz: answers per second, by node.
        said: latencies that nodes measured themselves, by hop.
        recorded: what the bag tells; None without a recorder.
        load: CPU time and the machine's load.
    """

    step: Step
    failure: str = ""
    window_s: float = 0.0
    checks: tuple[Check, ...] = ()
    clocked: Mapping[str, Clocked] = field(default_factory=dict)
    answers_hz: Mapping[str, float] = field(default_factory=dict)
    said: Mapping[str, Percentiles] = field(default_factory=dict)
    recorded: Recorded | None = None
    load: MachineLoad | None = None

    @property
    def sound(self) -> bool:
        """Whether there is something to see, and all checks held."""
        return not self.failure and all(check.held for check in self.checks)


@dataclass(frozen=True, slots=True)
class _Watched:
    statuses: tuple[Status, ...]
    window_ns: tuple[int, int]
    usages: tuple[Usage, Usage]


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
        watched = _watch(step, str(scene), seconds, folder, bag)
        return _evaluated(step, watched, bag, point, session)
    except HapticMechError as error:
        return Run(step, failure=str(error))
    finally:
        shutil.rmtree(bag, ignore_errors=True)


def _watch(step: Step, scene: str, seconds: float, folder: Path, bag: Path) -> _Watched:
    environment = graph_environment()
    with ExitStack() as stack:
        with output_to(folder / "nodes.log"):
            probe = stack.enter_context(ReportingProcess(probe_command(), environment))
            others = {"probe": probe}
            if step.configuration.recorded:
                command = recorder_command(bag, scene)
                others["recorder"] = stack.enter_context(ReportingProcess(command, environment))
            graph = stack.enter_context(start_graph(step, scene, environment))
        processes = ids({**graph.processes, **{n: one.process for n, one in others.items()}})
        wait_until_engaged(graph, probe)
        begun_ns, before = time.time_ns(), usage(processes)
        _wait(graph, seconds)
        after, ended_ns = usage(processes), time.time_ns()
        wait_until(
            lambda: set(NODES) <= _speaking(probe, ended_ns),
            SPEAKS_WITHIN_S,
            "every node's figures after the window",
            graph.check,
        )
        statuses = tuple(_statuses(probe))
    return _Watched(statuses, (begun_ns, ended_ns), (before, after))


def wait_until_engaged(graph: Graph, probe: ReportingProcess) -> None:
    """Wait until every node works, and a little longer.

    Raises:
        BenchError: it does not come to that in 30 s; says what the nodes say.
        NodeDiedError: a node has ended.
    """

    def engaged() -> bool:
        last = {status.node: status.message for status in _statuses(probe)}
        return set(NODES) <= set(last) and last[CONTROLLER] == ENGAGED

    try:
        wait_until(engaged, ENGAGES_WITHIN_S, "the graph to engage", graph.check)
    except BenchError as error:
        last = {status.node: status.message for status in _statuses(probe)}
        said_last = "; ".join(f"{node}: {message}" for node, message in sorted(last.items()))
        raise BenchError(f"{error} ({said_last or 'no node spoke'})") from None
    _wait(graph, SETTLES_S)


def _wait(graph: Graph, seconds: float) -> None:
    end = time.monotonic() + seconds
    while (left := end - time.monotonic()) > 0.0:
        graph.check()
        time.sleep(min(left, 0.5))


def _speaking(probe: ReportingProcess, since_ns: int) -> set[str]:
    return {status.node for status in _statuses(probe) if status.stamp_ns >= since_ns}


def _statuses(probe: ReportingProcess) -> list[Status]:
    return [status_of(event) for event in probe.of("status")]


def _evaluated(step: Step, watched: _Watched, bag: Path, point: str, session: Expected) -> Run:
    window = watched.window_ns
    ends = {}
    for node in NODES:
        pair = around(watched.statuses, node, window)
        if pair is None:
            raise BenchError(f"{node} gave no figures before and after the window")
        ends[node] = pair
    within = [
        status
        for status in watched.statuses
        if status.node in ends
        and ends[status.node][0].stamp_ns <= status.stamp_ns <= ends[status.node][1].stamp_ns
    ]
    window_s = (window[1] - window[0]) / NANOSECONDS
    kept = {node: clocked(ends[node]) for node in (DEVICE, MECHANISM)}
    checks = check_run(step.kind, ends, within, session)
    found = recorded(bag, point, window) if step.configuration.recorded else None
    if found is not None:
        rates = {node: one.rate_hz for node, one in kept.items()}
        checks = (*checks, check_recording(found, rates, window_s, point))
    return Run(
        step,
        window_s=window_s,
        checks=checks,
        clocked=kept,
        answers_hz={node: rate_hz(ends[node], figure) for node, figure in ANSWERS.items()},
        said=said(ends),
        recorded=found,
        load=load_between(*watched.usages),
    )


class BareGraph(Graph):
    """The bare graph's nodes in the real one's layout; see bare_node.py."""

    def __init__(
        self, scene: str, composed: bool, environment: Mapping[str, str], view_hz: float = VIEW_HZ
    ) -> None:
        self.processes = {}
        self._readiness = Readiness()
        arguments = ros_arguments({"scene": scene, "view_rate": view_hz})
        try:
            for group in [",".join(NODES)] if composed else list(NODES):
                command = [sys.executable, "-m", BARE, group, *arguments]
                self.processes[group] = start_process(command, environment)
        except BaseException:
            self.stop()
            raise


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


def recorder_command(bag: Path, scene: str) -> list[str]:
    """Return the command that records every topic of a graph until a signal ends it.

    It prints a line of JSON with the event ``ready`` once it listens.
    """
    command = [sys.executable, "-m", RECORDER, "--out", str(bag), "--scene", scene]
    return [*command, "--duration", str(FOR_EVER_S), "--start-timeout", str(FOR_EVER_S)]


def probe_command() -> list[str]:
    """Return the command that prints what the nodes say of themselves."""
    return [sys.executable, "-m", PROBE]
