# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Who else on the network is heard: a meddler on another host, beside a graph started as usual.

A node of the graph's own host looks on: it must see the graph, so that nothing seen from the other
host means something; and with the network opened, the same meddler must succeed.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from benchmarks.children import finding_benchmarks
from benchmarks.reliability.emulated_network import ADDRESSES, DEVICE, REST, EmulatedNetwork
from benchmarks.reliability.figure import Figure
from hapticmech_ros.compilation.library import compile_ahead
from hapticmech_ros.errors import HapticMechError
from hapticmech_ros.graph.processes import stop_process
from hapticmech_ros.system.discovery import PEERS, PROFILES, RANGE

DOMAIN = "7"
STARTS_WITHIN_S = 30.0
VISITOR = [sys.executable, "-m", "benchmarks.reliability.visitor"]


class NoVisitError(HapticMechError):
    """A visitor that ended without a report."""


@dataclass(frozen=True, slots=True)
class Visit:
    """What came of a visit.

    Attributes:
        topics: of the graph, seen from the other host.
        pushes: whether the graph obeyed a push from there.
        parameters: set from there.
        transitions: of nodes, from there.
        seen_here: topics of the graph, seen from its own host.
        told: what the graph's nodes printed.
    """

    topics: int
    pushes: int
    parameters: int
    transitions: int
    seen_here: int
    told: str


def plain_environment(**given: str) -> dict[str, str]:
    """Return this environment without any choice of who finds whom, but for what is given."""
    chosen = {RANGE, PEERS, PROFILES, "FASTDDS_BUILTIN_TRANSPORTS", "ROS_LOCALHOST_ONLY"}
    rest = {name: value for name, value in os.environ.items() if name not in chosen}
    return finding_benchmarks({**rest, "ROS_DOMAIN_ID": DOMAIN, **given})


def visit(log: Path, seconds: float, *options: str) -> Visit:
    """Let a meddler on another host visit a graph for a while, where two hosts can be emulated.

    Args:
        log: file for what the graph prints.
        seconds: s.
        options: of ``hapticmech run``, beside its defaults.

    Raises:
        NoVisitError: a visitor that ended without a report.
    """
    compile_ahead()
    with EmulatedNetwork() as network, log.open("w") as told:
        run = [sys.executable, "-m", "hapticmech_ros", "run", "five_bar", "--composed", *options]
        with _process(network.command(DEVICE, run), plain_environment(), told):
            # Until it is there, as its own host sees it.
            _wait_for_graph(network)
            here = network.command(DEVICE, [*VISITOR, str(seconds + 2.0)])
            meddle = network.command(REST, [*VISITOR, str(seconds), "--meddle"])
            # To whom it need not announce itself: he knows where to look.
            there = plain_environment(**{PEERS: ADDRESSES[DEVICE]})
            with (
                _process(here, plain_environment()) as onlooker,
                _process(meddle, there) as meddler,
            ):
                seen_there, seen_here = _report(meddler), _report(onlooker)
    return Visit(
        topics=len(seen_there["topics"]),
        pushes=len(seen_here["pushed_by"]),
        parameters=seen_there["parameters_set"],
        transitions=seen_there["transitions"] + len(seen_here["inactive"]),
        seen_here=len(seen_here["topics"]),
        told=log.read_text(encoding="utf-8"),
    )


def run(quick: bool, out: Path) -> list[Figure]:
    """Return figures of a graph started as usual, and of one that is opened.

    Raises:
        NoNetworkError: no network can be emulated here.
    """
    trials = 1 if quick else 5
    closed = [visit(out / f"closed_{i}.log", 8.0) for i in range(trials)]
    opened = [visit(out / f"open_{i}.log", 8.0, "--discovery", "subnet") for i in range(trials)]
    warned = sum("open to the network" in one.told for one in opened)

    def least(name: str, found: Iterable[int], bound: float = 1.0) -> Figure:
        return Figure(name, float(min(found)), least=bound, trials=trials)

    return [
        Figure(
            "topics found from another host", max(v.topics for v in closed), "", 0.0, None, trials
        ),
        Figure("its pushes obeyed", max(v.pushes for v in closed), "", 0.0, None, trials),
        Figure("its parameters set", max(v.parameters for v in closed), "", 0.0, None, trials),
        Figure("nodes stopped by it", max(v.transitions for v in closed), "", 0.0, None, trials),
        least("topics found on its own host", (v.seen_here for v in closed), 10.0),
        least("opened: topics found", (v.topics for v in opened), 10.0),
        least("opened: pushes obeyed", (v.pushes for v in opened)),
        least("opened: parameters set", (v.parameters for v in opened)),
        least("opened: nodes stopped", (v.transitions for v in opened)),
        Figure("opened: said at the start", warned, "runs", None, trials, trials),
    ]


def _wait_for_graph(network: EmulatedNetwork) -> None:
    for _ in range(int(STARTS_WITHIN_S / 3.0)):
        look = network.command(DEVICE, [*VISITOR, "3"])
        with _process(look, plain_environment()) as onlooker:
            if len(_report(onlooker)["topics"]) >= 10:
                return
    raise NoVisitError(f"no graph to be seen on its own host within {STARTS_WITHIN_S:g} s")


@contextmanager
def _process(
    command: list[str], environment: dict[str, str], told: Any = subprocess.PIPE
) -> Iterator[subprocess.Popen[str]]:
    """Run a process as a user would start it: nothing of its environment is chosen for it."""
    beside = None if told is subprocess.PIPE else subprocess.STDOUT
    process = subprocess.Popen(command, env=environment, stdout=told, stderr=beside, text=True)
    try:
        yield process
    finally:
        stop_process(process)
        if process.stdout is not None:
            process.stdout.close()


def _report(visitor: subprocess.Popen[str]) -> dict[str, Any]:
    for line in visitor.stdout or ():
        if line.startswith("{"):
            return dict[str, Any](json.loads(line))
    raise NoVisitError("a visitor ended without a report")
