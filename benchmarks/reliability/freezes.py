# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Part ``freezes``: each node stopped (SIGSTOP) for 50 periods to 2 s, and let go on (SIGCONT)."""

from __future__ import annotations

import random
import time
from pathlib import Path

import psutil

from benchmarks.children import wait_until
from benchmarks.reliability.figure import Figure
from benchmarks.reliability.rig import Rig
from benchmarks.reliability.trial import Fault, Trial, each_node, observe
from hapticmech_ros.nodes.timeouts import ByRate
from hapticmech_ros.wire.topics import DEVICE

SHORTEST, LONGEST_S = ByRate(50, 0.05), 2.0
STOPS_WITHIN_S = 2.0
SEED = 0


def run(quick: bool, out: Path, rate: float = 0.0) -> list[Figure]:
    """Freeze each node 100 times (quick: twice), in turn, at a control rate (Hz; 0: the scene's).

    For fifty periods, at least 50 ms, to 2 s: all that a loop at that rate must not overlook.
    """
    chance = random.Random(SEED)

    def freeze(rig: Rig, node: str) -> Trial:
        # As many short ones as long ones: even on a logarithmic scale.
        shortest_s = SHORTEST.at(rig.period_s)
        return try_freeze(rig, node, shortest_s * (LONGEST_S / shortest_s) ** chance.random())

    return each_node("freezes", quick, out, rate, freeze)


def try_freeze(rig: Rig, node: str, seconds: float) -> Trial:
    """Freeze a node, let it go on, and return what the device did.

    The simulated device's actuators freeze with it: what counts is that its first output afterwards
    is zero, and not a command from before.
    """
    since, process = rig.ready(), psutil.Process(rig.pid(node))
    frozen_ns = time.monotonic_ns()
    process.suspend()
    try:
        # No signal acts at once.
        wait_until(
            lambda: process.status() == psutil.STATUS_STOPPED,
            STOPS_WITHIN_S,
            f"process {process.pid} to stop on SIGSTOP",
            look_again_s=0.0,
        )
        stopped_ns = time.monotonic_ns()
        time.sleep(seconds)
        before = rig.ring.count
    finally:
        released_ns = time.monotonic_ns()
        process.resume()
    if of_device := node == DEVICE:
        since, frozen_ns = before, stopped_ns
    kind = f"{node} frozen for {seconds:.2f} s"
    fault = Fault(kind, since, frozen_ns, released_ns, first_output=of_device)
    return observe(rig, fault, bool)
