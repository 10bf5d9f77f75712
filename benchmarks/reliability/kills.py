# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Part ``kills``: each node killed without warning, and started again."""

from __future__ import annotations

import time
from pathlib import Path

from benchmarks.reliability.figure import Figure
from benchmarks.reliability.rig import Rig
from benchmarks.reliability.trial import Fault, Trial, each_node, observe
from hapticmech_ros.wire.topics import CONTROLLER, DEVICE

# Gone for so long: others have noticed by then.
GONE_S = 0.3
# The moment of a kill is to be known so well.
MOMENT_NS = 1_000_000


def run(quick: bool, out: Path, rate: float = 0.0) -> list[Figure]:
    """Kill each node 100 times (quick: twice), in turn, at a control rate (Hz; 0: the scene's)."""
    missed = 0

    def kill(rig: Rig, node: str) -> Trial:
        nonlocal missed
        while (trial := try_kill(rig, node)) is None:
            missed += 1
        return trial

    figures = each_node("kills", quick, out, rate, kill)
    left_out = Figure(
        "kills that are left out",
        missed,
        note="the watcher met the new device later than the controller did, or the moment of the "
        "kill is not known to a millisecond",
    )
    return [*figures, left_out]


def try_kill(rig: Rig, node: str) -> Trial | None:
    """Kill a node, start it again, and return what the device did.

    The device's own force ends with its process: what counts is that it begins without any. None if
    its first output was not seen, or the moment of the kill is not known.
    """
    since = rig.ready()
    killed_ns = time.monotonic_ns()
    rig.graph_of(node).processes[node].kill()
    # Between two looks at the clock, and this process may have had to wait meanwhile.
    known = time.monotonic_ns() - killed_ns < MOMENT_NS
    rig.graph_of(node).kill(node)
    time.sleep(GONE_S)
    alive = rig.ended() == [node]
    if of_device := node == DEVICE:
        since = rig.ring.count
    restarted_ns = time.monotonic_ns()
    rig.restart(node)
    fault = Fault(f"{node} killed", since, killed_ns, restarted_ns, first_output=of_device)
    trial = observe(rig, fault, bool, alive)
    unseen = of_device and _missed_first(rig, since, restarted_ns)
    return trial if known and not unseen else None


def _missed_first(rig: Rig, begun: int, restarted_ns: int) -> bool:
    """Return whether the first message seen of a new device is none of its first ones.

    Numbers tell how many the middleware brought to nobody; what went over the lane alone before the
    watcher was met has none. By then the controller was engaged, and the device may push.
    """
    found = rig.samples(begun)
    found = found[found["arrived_ns"] >= restarted_ns]
    if not found.size:
        return False
    first = int(found["arrived_ns"][0])
    engaged = any(
        event["node"] == CONTROLLER and event["text"] == "engaged" and event["at_ns"] < first
        for event in rig.said(restarted_ns)
    )
    return engaged or int(found["number"][0]) > 1
