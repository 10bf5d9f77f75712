# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A graph of which one process stands still says which: itself by its clock, a peer by messages."""

from __future__ import annotations

import os
import re
import signal
import time
from collections.abc import Callable

import pytest
from rcl_interfaces.msg import Log

from hapticmech_ros.graph.processes import Graph, private_environment
from ros.harness import Peer

CONTROLLER, DEVICE = "teleoperation_controller", "haptic_device"
# Longer than a busy machine lets anybody wait, so that what is told of it is of this.
FROZEN_S, FROZEN_MS = 2.0, 1500.0
OWN = "this process had no processor"


def paused(logs: list[Log], node: str, words: str) -> bool:
    """Return whether a node has said that somebody paused for as long as a process was frozen."""
    found = [re.search(rf"{words} for (\d+) ms", log.msg) for log in logs if log.name == node]
    return any(match and float(match[1]) > FROZEN_MS for match in found)


def freezing(pid: int, condition: Callable[[], bool]) -> Callable[[], bool]:
    """Return a condition for which a process is frozen now and then until it holds."""
    again = [0.0]

    def holds() -> bool:
        if condition():
            return True
        if time.monotonic() > again[0]:
            os.kill(pid, signal.SIGSTOP)
            time.sleep(FROZEN_S)
            os.kill(pid, signal.SIGCONT)
            again[0] = time.monotonic() + 5.0
        return False

    return holds


@pytest.mark.parametrize(
    ("frozen", "peer_node", "words"),
    [(CONTROLLER, DEVICE, ""), (DEVICE, CONTROLLER, "the device had paused")],
)
def test_a_process_that_was_frozen_is_told_apart_from_its_peer(
    domain: int, peer: Peer, frozen: str, peer_node: str, words: str
) -> None:
    statuses, logs = peer.statuses(), peer.listen("/rosout", Log)
    often = {"diagnostics_period": 0.1}
    with Graph("five_bar", parameters=often, environment=private_environment(domain)) as graph:
        peer.until(lambda: statuses.well(CONTROLLER, DEVICE), "rendering")

        def told() -> bool:
            own = paused(logs, frozen, OWN)
            return own and (not words or paused(logs, peer_node, words))

        peer.until(freezing(graph.processes[frozen].pid, told), "both to say it", 60.0)
        peer.until(lambda: statuses.count(frozen, "lost_without_processor"), "the count of it")
        # Which of them stood still is not mixed up.
        assert not paused(logs, peer_node, OWN)
        assert statuses.count(peer_node, "losses") > 0
