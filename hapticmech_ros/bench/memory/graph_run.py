"""The graph of nodes, watched while it runs."""

from __future__ import annotations

import time
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path

from hapticmech_ros.bench.children import BenchError, Teller, ids, output_to
from hapticmech_ros.bench.graphs import graph_environment, probe_command, start_graph
from hapticmech_ros.bench.memory.watch import Watch
from hapticmech_ros.bench.plan import Configuration, Layout, Step, scene_at_rate
from hapticmech_ros.bench.run import wait_until_engaged
from hapticmech_ros.bench.words import status_of
from hapticmech_ros.nodes.entry import NODES

RATE_HZ = 1000.0
MINUTE = 60.0

Show = Callable[[str], None]


def watch_graph(
    scene: str,
    minutes: float,
    period: float,
    folder: Path,
    layout: Layout = "separate",
    show: Show = lambda line: None,
) -> tuple[Watch, dict[str, str]]:
    """Run a private graph at 1 kHz, and return how large its processes were meanwhile.

    Args:
        scene: shipped scene, or path of a file.
        minutes: how long, from when the graph works.
        period: s between samples.
        folder: for what the nodes print, and the scene at 1 kHz.
        layout: a process for each node, or one for all.
        show: told once a minute.

    Returns:
        The samples, and by node what it said of itself last.

    Raises:
        BenchError: the graph does not begin to work, or a node ended.
    """
    path = scene_at_rate(scene, RATE_HZ, folder)
    step = Step(Configuration(RATE_HZ, layout, False), 1, "real")
    environment, watch = graph_environment(), Watch()
    with ExitStack() as stack:
        with output_to(folder / "memory_nodes.log"):
            probe = stack.enter_context(Teller(probe_command(), environment))
            graph = stack.enter_context(start_graph(step, str(path), environment))
        processes = ids(graph.processes)
        wait_until_engaged(graph, probe)
        begun, told = time.monotonic(), 0.0
        while (passed := time.monotonic() - begun) < MINUTE * minutes:
            graph.check()
            if not watch.look(passed, processes):
                raise BenchError(f"a node ended after {passed:.0f} s")
            if passed >= told:
                show(f"graph: {passed / MINUTE:.0f} of {minutes:g} minutes")
                told += MINUTE
            time.sleep(period)
        last = {status.node: status.message for status in map(status_of, probe.of("status"))}
    return watch, {node: last.get(node, "") for node in NODES}
