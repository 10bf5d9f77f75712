# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Part ``freezes``: each node stopped (SIGSTOP) for 50 periods to 2 s, and let go on (SIGCONT)."""

from __future__ import annotations

import os
import random
import signal
import time
from collections.abc import Callable
from pathlib import Path

from benchmarks.children import BenchError
from benchmarks.reliability.figure import Figure
from benchmarks.reliability.rig import Rig
from benchmarks.reliability.trial import (
    Fault,
    Trial,
    observe,
    report_delays,
    report_sockets,
    summarised,
)
from hapticmech_ros.nodes.entry import NODES
from hapticmech_ros.nodes.timeouts import ByRate
from hapticmech_ros.wire.topics import DEVICE

PART = "freezes"
TRIALS, QUICK_TRIALS = 100, 2
SHORTEST, LONGEST_S = ByRate(50, 0.05), 2.0
STOPS_WITHIN_S = 2.0
SEED = 0


def run(
    quick: bool, out: Path, told: Callable[[str], None] = print, rate: float = 0.0
) -> list[Figure]:
    """Freeze each node 100 times (quick: twice), in turn, at a control rate (Hz; 0: the scene's).

    For fifty periods, at least 50 ms, to 2 s: all that a loop at that rate must not overlook.
    """
    number = QUICK_TRIALS if quick else TRIALS
    chance = random.Random(SEED)
    trials: dict[str, list[Trial]] = {node: [] for node in NODES}
    with Rig(out, PART, rate=rate) as rig:
        shortest_s = SHORTEST.at(rig.period_s)
        for _ in range(number):
            for node in NODES:
                # As many short ones as long ones: even on a logarithmic scale.
                seconds = shortest_s * (LONGEST_S / shortest_s) ** chance.random()
                trials[node].append(try_freeze(rig, node, seconds))
                told(trials[node][-1].log(rig.clean_max))
        rig.ready()
        figures = [*report_delays(PART, rig), report_sockets(PART, rig)]
        for node, found in trials.items():
            figures += summarised(PART, node, found, rig.clean_max)
    return figures


def try_freeze(rig: Rig, node: str, seconds: float) -> Trial:
    """Freeze a node, let it go on, and return what the device did.

    The simulated device's actuators freeze with it: what counts is that its first output afterwards
    is zero, and not a command from before.
    """
    since, pid = rig.ready(), rig.pid(node)
    frozen_ns = time.monotonic_ns()
    os.kill(pid, signal.SIGSTOP)
    try:
        stopped_ns = _stopped(pid)
        time.sleep(seconds)
        before = rig.ring.count
    finally:
        released_ns = time.monotonic_ns()
        os.kill(pid, signal.SIGCONT)
    kind = f"{node} frozen for {seconds:.2f} s"
    if node == DEVICE:
        fault = Fault(kind, before, stopped_ns, released_ns, first_output=True)
    else:
        fault = Fault(kind, since, frozen_ns, released_ns)
    trial = observe(rig, fault, bool)
    if not trial.came_back:
        rig.renew()
    return trial


def _stopped(pid: int) -> int:
    """Wait until a process stands still, and return when (monotonic, ns): no signal acts at once.

    Raises:
        BenchError: it does not.
    """
    path = Path("/proc") / str(pid) / "stat"
    end = time.monotonic() + STOPS_WITHIN_S
    # The state comes after the name, which stands in brackets and may hold anything.
    while path.read_text("utf-8").rpartition(")")[2].split()[0] != "T":
        if time.monotonic() > end:
            raise BenchError(f"process {pid} does not stop on SIGSTOP")
    return time.monotonic_ns()
