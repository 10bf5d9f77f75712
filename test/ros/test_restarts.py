# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Nodes that are killed and started anew at random, two hundred times, and those that are not."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

import sampling
from hapticmech_ros.nodes.entry import NODES
from hapticmech_ros.nodes.lane import lane_folder
from ros.harness import RATE, Peer, Statuses, program
from sampling import only_long

STORM = Path(__file__).with_name("restart_storm.py")
RESTARTS = 200 if sampling.LONG else 80

# All that rclpy's events executor waits for at a node, once it is configured.
EVENTS = """
import sys
import rclpy
from hapticmech_ros.nodes.exchange import Exchange
from hapticmech_ros.nodes.managed import ManagedNode
from hapticmech_ros.nodes.runtime import actor_type
rclpy.init(args=sys.argv[2:])
node = ManagedNode(actor_type(sys.argv[1]), Exchange())
node.start()
ends = [*node.publishers, *node.subscriptions]
print(len(ends), sum(len(end.event_handlers) for end in ends))
"""


@pytest.mark.parametrize("name", list(NODES))
def test_no_node_asks_the_middleware_for_events(name: str, environment: dict[str, str]) -> None:
    """Whoever takes one may wait for ever, while the middleware brings the next."""
    command = [sys.executable, "-c", EVENTS, name]
    run = subprocess.run(command, stdout=subprocess.PIPE, text=True, check=True, env=environment)
    ends, events = map(int, run.stdout.split())
    assert ends > 5
    assert events == 0


@pytest.mark.alone
@pytest.mark.parametrize("transport", ["auto", *only_long("middleware")])
def test_a_storm_of_restarts_stops_nobody_else_and_leaves_nothing(
    transport: str, domain: int, environment: dict[str, str], peer: Peer, statuses: Statuses
) -> None:
    command = [sys.executable, str(STORM), "7", str(RESTARTS), transport, f"{RATE}"]
    with program(domain, *command, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as storm:
        told = json.loads(storm.stdout.readline())
        assert sum(told["killed"].values()) == RESTARTS
        assert told["unasked"] == []
        statuses.clear()
        peer.until(lambda: statuses.well(*NODES), "all four to work")
        if transport == "auto":
            folder = lane_folder(environment)
            peer.until(lambda: len(list(folder.iterdir())) == len(NODES), "no more sockets")
        storm.communicate(timeout=20.0)
    assert storm.returncode == 0
