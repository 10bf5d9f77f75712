# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Who can find a graph, and who can meddle with it: processes on its machine, and nobody else."""

import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from benchmarks.reliability.emulated_network import not_permitted
from benchmarks.reliability.exposure import plain_environment, visit
from hapticmech_ros.graph.processes import stop_process
from hapticmech_ros.system.discovery import RANGE, listening
from ros.harness import Peer, Statuses

REASON = not_permitted()
of_two_hosts = pytest.mark.skipif(bool(REASON), reason=REASON)

COMMANDS = {
    "node": ["-m", "hapticmech_ros.nodes.entry", "haptic_device"],
    "run": ["-m", "hapticmech_ros", "run", "two_link", "--composed", "--view"],
    "record": ["-m", "hapticmech_ros", "run", "two_link", "--composed", "--record", "bag"],
}


@contextmanager
def started(name: str, domain: int, folder: Path, **given: str) -> Iterator[subprocess.Popen[str]]:
    """Start a command as a user does, in a shell where nothing is chosen but what is given."""
    environment = plain_environment(ROS_DOMAIN_ID=str(domain), **given)
    command = [sys.executable, *COMMANDS[name]]
    # Not by start_process(), which chooses for its children: the command must do so itself.
    process = subprocess.Popen(command, env=environment, cwd=folder, text=True)
    try:
        yield process
    finally:
        stop_process(process)


def family(process: int) -> list[int]:
    """Return a process and its children."""
    children = Path(f"/proc/{process}/task/{process}/children").read_text().split()
    return [process, *(one for child in children for one in family(int(child)))]


@pytest.mark.parametrize("name", COMMANDS)
def test_nothing_listens_to_the_network(
    name: str, domain: int, peer: Peer, statuses: Statuses, tmp_path: Path
) -> None:
    with started(name, domain, tmp_path) as process:
        peer.until(lambda: statuses, "a node")
        if name == "record":
            peer.until(lambda: "bag_recorder" in peer.node.get_node_names(), "a recorder")
        family_of = family(process.pid)
        assert len(family_of) == {"node": 1, "run": 2, "record": 3}[name]
        assert [list(listening(one)) for one in family_of] == [[]] * len(family_of)


def test_who_asks_for_the_network_listens_to_it(
    domain: int, peer: Peer, statuses: Statuses, tmp_path: Path
) -> None:
    """As a check of the check."""
    with started("node", domain, tmp_path, **{RANGE: "SUBNET"}) as process:
        peer.until(lambda: statuses, "a node")
        assert ("UDP", "0.0.0.0") in list(listening(process.pid))


@of_two_hosts
def test_another_host_finds_nothing_and_moves_nothing(tmp_path: Path) -> None:
    found = visit(tmp_path / "told", 5.0)
    assert (found.topics, found.pushes, found.parameters, found.transitions) == (0, 0, 0, 0)
    # A node on the graph's own host, started without any setting, saw it all the while.
    assert found.seen_here > 10
    assert "open to the network" not in found.told


@of_two_hosts
def test_another_host_finds_what_was_opened_and_that_is_said(tmp_path: Path) -> None:
    found = visit(tmp_path / "told", 6.0, "--discovery", "subnet")
    assert found.topics > 10
    assert found.pushes == 1
    assert found.parameters == 1
    assert found.transitions > 0
    assert "open to the network (UDP 0.0.0.0" in found.told
    assert f"to restrict nodes to this machine: export {RANGE}=LOCALHOST" in found.told
