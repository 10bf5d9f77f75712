# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The set-up of every trial: a graph, a watcher outside it, and what a clean run does."""

from __future__ import annotations

import sys
import tempfile
import time
from collections.abc import Collection, Mapping, Sequence
from contextlib import ExitStack, suppress
from pathlib import Path
from typing import Any

import numpy as np
import psutil

from benchmarks.children import (
    BenchError,
    ReportingProcess,
    finding_benchmarks,
    output_to,
    wait_until,
)
from benchmarks.reliability.sample import DEVICE, Ring, Samples
from benchmarks.reliability.stepped_clock import SteppedClock
from hapticmech_ros.compilation.library import compile_ahead
from hapticmech_ros.graph.processes import Graph, private_environment
from hapticmech_ros.loading import load_scene
from hapticmech_ros.nodes.entry import NODES
from hapticmech_ros.nodes.lane import lane_folder
from hapticmech_ros.nodes.node_time import wall_ahead_ns
from hapticmech_ros.wire.topics import DEVICE as DEVICE_NODE

SCENE, POINT = "five_bar", "handle"
WITHIN_S = 20.0
# Rendering for so long without a break before anything is done to the graph.
SETTLED_S = 0.7
CLEAN_S = 2.0
TRIES = 8
MS = 1_000_000
# Nodes of one host, and its clock if that is one which is stepped.
Host = tuple[Collection[str], SteppedClock | None]


class Rig:
    """A graph of the shipped five-bar in a process each, in a domain of its own, and a watcher.

    Use as a context manager: leaving it ends every process.

    Args:
        out: folder for what the nodes print (``NAME.log``).
        name: of the log.
        hosts: groups of nodes with clocks of their own; all by the machine's if left out.
        parameters: for the graph's nodes.
        all_topics: watch the mechanism's and the analyser's messages too.
        clock: what /clock says each period, for nodes with ``use_sim_time``; nobody publishes it if
            left out.
        domain: ROS_DOMAIN_ID; one that is probably free if left out.
        clean: measure a clean run first.
        composed: all nodes of a host in one process, which takes a machine least.
        variables: of the environment of all, besides the usual ones.
        rate: control rate, Hz; 0: the scene's own.

    Attributes:
        environment: of a process that is to meet the graph, with the machine's own clock.
        clean_max: the largest force (N) of a run to which nothing is done.
        lateness_ns: (n,) how long after their stamps the device's samples arrived in that run.
        period_s: control period, s.
    """

    def __init__(
        self,
        out: Path,
        name: str,
        hosts: Sequence[Host] = ((tuple(NODES), None),),
        parameters: Mapping[str, object] | None = None,
        all_topics: bool = False,
        clock: SteppedClock | None = None,
        domain: int | None = None,
        clean: bool = True,
        composed: bool = False,
        variables: Mapping[str, str] | None = None,
        rate: float = 0.0,
    ) -> None:
        out.mkdir(parents=True, exist_ok=True)
        self._log = out / f"{name}.log"
        self._hosts = hosts
        self.period_s = load_scene(SCENE, rate).simulation.period
        self._parameters = {
            "diagnostics_period": 0.2,
            "control_rate": rate,
            **(parameters or {}),
        }
        self._all_topics = all_topics
        self._clock = clock
        self._clean = clean
        self._composed = composed
        self._graphs: list[Graph] = []
        self.environment = {
            **finding_benchmarks(private_environment(domain)),
            "OPENBLAS_NUM_THREADS": "1",
            **(variables or {}),
        }
        self.clean_max = 0.0
        self.lateness_ns = np.zeros(0)

    def __enter__(self) -> Rig:
        """Start watcher and graph, and measure a clean run if asked to.

        Raises:
            BenchError: the device does not render.
        """
        # Whoever comes first compiles the kernels, for most of a minute: not one of those watched.
        compile_ahead()
        with ExitStack() as stack:
            self._stack = stack
            folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
            self.ring = Ring(folder / "ring", fresh=True)
            point = [POINT] if self._all_topics else []
            self.watch = self.start("watch", str(folder / "ring"), *point)
            if self._clock is not None:
                environment = self._clock.environment(self.environment)
                self.start("clock_source", f"{self.period_s}", environment=environment)
            stack.callback(self._stop_graph)
            begun = self.renew()
            if self._clean:
                self._run_clean(begun)
            self._stack = stack.pop_all()
        return self

    def __exit__(self, *error: object) -> None:
        self._stack.close()

    def start(
        self, module: str, *arguments: str, environment: Mapping[str, str] | None = None
    ) -> ReportingProcess:
        """Start a module of this folder that meets the graph, and ends with the rig."""
        command = [sys.executable, "-m", f"benchmarks.reliability.{module}", *arguments]
        with output_to(self._log):
            return self._stack.enter_context(
                ReportingProcess(command, environment or self.environment)
            )

    def another(self, node: str) -> Graph:
        """Start a second node of a kind, called ``second_...``; whoever asked ends it."""
        return self._graph([node], ["-r", f"__node:=second_{node}"])

    @property
    def offset_ns(self) -> int:
        """How far the device's clock is ahead of the machine's now, ns."""
        clock = self._clock or self._clock_of(DEVICE_NODE)
        return 0 if clock is None else clock.offset_ns

    def environment_of(self, node: str) -> dict[str, str]:
        """Return the environment of a process on a node's host."""
        clock = self._clock_of(node)
        return self.environment if clock is None else clock.environment(self.environment)

    def renew(self) -> int:
        """End the graph and start it again, all nodes; return the ring's number before."""
        self._stop_graph()
        before = self.ring.count
        self._graphs += [self._graph(nodes) for nodes, _ in self._hosts]
        return before

    def graph_of(self, node: str) -> Graph:
        """Return the part of the graph that a node belongs to, which kills and restarts it."""
        return next(graph for graph in self._graphs if node in graph.processes)

    def pid(self, node: str) -> int:
        """Return the id of a node's process."""
        return self.graph_of(node).processes[node].pid

    def shares(self) -> dict[int, float]:
        """Return how much of a processor each node takes while the device renders, %, by its id.

        Raises:
            BenchError: the device does not render, or a node ended.
        """
        self.settle()
        ids = (process.pid for graph in self._graphs for process in graph.processes.values())
        nodes = [psutil.Process(one) for one in ids]
        for node in nodes:
            node.cpu_percent()
        time.sleep(CLEAN_S)
        self.check()
        return {node.pid: node.cpu_percent() for node in nodes}

    def ended(self) -> list[str]:
        """Return the nodes whose processes are no more."""
        return [name for graph in self._graphs for name in graph.ended()]

    def sockets_left(self) -> int:
        """Return how many sockets of nodes that are no more are left after a while."""
        folder = lane_folder(self.environment)

        def left() -> int:
            return len(list(folder.iterdir())) - sum(len(graph.processes) for graph in self._graphs)

        with suppress(BenchError):
            wait_until(lambda: left() <= 0, WITHIN_S, "sockets to be removed", self.check)
        return left()

    def restart(self, node: str) -> None:
        """Start a node again that has ended."""
        with output_to(self._log):
            self.graph_of(node).restart(node)

    def samples(self, since: int, *topics: int) -> Samples:
        """Return topics' samples (the device's if none is named) from a number of the ring on."""
        found = self.ring.since(since)
        return found[np.isin(found["topic"], topics or (DEVICE,))]

    def said(self, since_ns: int) -> list[dict[str, Any]]:
        """Return what nodes said in diagnostics and logs since a time of the monotonic clock."""
        return [event for event in self.watch.of("said") if event["at_ns"] >= since_ns]

    def ready(self) -> int:
        """Wait until the device renders, with a new graph if need be; as :meth:`settle`."""
        try:
            return self.settle()
        except BenchError:
            self.renew()
            return self.settle()

    def settle(self, since_ns: int = 0) -> int:
        """Wait until the device has rendered without a break; return the ring's number then.

        Args:
            since_ns: count what came after this time of the monotonic clock alone.

        Raises:
            BenchError: it does not, or a node ended.
        """
        wait_until(lambda: self._settled(since_ns), WITHIN_S, "the device to render", self.check)
        return self.ring.count

    def check(self) -> None:
        """Raise BenchError if the watcher or a node has ended."""
        self.watch.check()
        if ended := self.ended():
            raise BenchError(f"{', '.join(ended)} ended by itself")

    def _settled(self, since_ns: int) -> bool:
        now = time.monotonic_ns()
        begun = max(since_ns, now - int(SETTLED_S * 1e9))
        found = self.samples(self.ring.count - 20_000)
        found = found[found["arrived_ns"] >= begun]
        if now - since_ns < SETTLED_S * 1e9 or not len(found):
            return False
        # Samples all the while, down to a third of the rate.
        gap = np.diff(found["arrived_ns"], prepend=begun, append=now).max()
        enough = len(found) > 0.3 * SETTLED_S / self.period_s
        return bool(pushing(found).all() and enough and gap < 100 * MS)

    def _graph(self, nodes: Collection[str], arguments: Sequence[str] = ()) -> Graph:
        environment = self.environment_of(next(iter(nodes)))
        with output_to(self._log):
            return Graph(
                SCENE,
                composed=self._composed and len(nodes) > 1,
                parameters=self._parameters,
                environment=environment,
                nodes=nodes,
                arguments=arguments,
            )

    def _clock_of(self, node: str) -> SteppedClock | None:
        return next((clock for nodes, clock in self._hosts if node in nodes), None)

    def _stop_graph(self) -> None:
        while self._graphs:
            # As a context manager, which asks all to end before it waits for one.
            with self._graphs.pop():
                pass

    def _run_clean(self, begun: int) -> None:
        """Measure a run without a break; a starved machine may need some tries.

        Args:
            begun: the ring's number before the graph's start: the hand's first push is the hardest.
        """
        for _ in range(TRIES):
            with suppress(BenchError):
                self.settle()
            time.sleep(CLEAN_S)
            found = self.samples(begun)
            steady = found[np.maximum.accumulate(pushing(found))]
            if len(steady) > 0.5 * CLEAN_S / self.period_s and pushing(steady).all():
                self.clean_max = float(found["force"].max())
                # Stamps by this machine's monotonic clock.
                self.lateness_ns = steady["arrived_ns"] + wall_ahead_ns() - steady["stamp_ns"]
                return
            begun = self.renew()
        raise BenchError(f"no run of {CLEAN_S:g} s without a break in {TRIES}: too busy a machine")


def pushing(samples: Samples) -> np.ndarray:
    """Return (n,) whether the actuators push, or say what is no number."""
    return np.asarray((samples["force"] != 0.0) | (samples["torque"] != 0.0))
