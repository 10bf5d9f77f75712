# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""All four nodes: they find each other in any order, render, and survive each other's deaths."""

import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from geometry_msgs.msg import PoseStamped, WrenchStamped
from std_msgs.msg import UInt8

from hapticmech_ros.graph.processes import Graph
from hapticmech_ros.nodes.entry import NODES
from hapticmech_ros.nodes.messages import stamp_ns
from real_time import grants_real_time
from ros.harness import RATE, Peer, Statuses, figures, program, running

# With a machine that has other work.
PATIENT = {
    "teleoperation_controller.input_timeout": 0.1,
    "haptic_device.command_timeout": 0.1,
    "control_rate": RATE,
}


@pytest.mark.parametrize("composed", [False, True], ids=["four_processes", "composed"])
def test_the_hand_moves_the_mechanism(
    environment: dict[str, str], peer: Peer, statuses: Statuses, composed: bool
) -> None:
    device = peer.listen("device/measured_cp", PoseStamped)
    point = peer.listen("mechanism/handle/measured_cp", PoseStamped)
    counts = peer.listen("analysis/handle/constraint_count", UInt8)
    with Graph("five_bar", composed, parameters=PATIENT, environment=environment) as graph:
        peer.until(lambda: device and point and _travel(device) > 0.01, "the device to move 10 mm")
        peer.until(lambda: set(NODES) <= set(statuses), "diagnostics of all nodes")
        peer.until(lambda: counts, "a count")
        peer.until(lambda: _travel(point) > 0.01, "the point to move 10 mm")
        assert counts[-1].data in (1, 2)
        told = "loop_latency_p50_us"
        peer.until(lambda: float(figures(statuses["haptic_device"])[told]) > 0.0, "a latency")
        graph.check()
        codes = graph.stop()
    assert set(codes.values()) == {0}


def test_composed_nodes_hear_each_other_once_and_others_too(
    domain: int, peer: Peer, statuses: Statuses
) -> None:
    commands = peer.listen("device/servo_cf", WrenchStamped)
    with running(",".join(NODES), domain, diagnostics_period=0.1, realtime="on"):
        # With a listener outside, each answer also comes back to the process: it counts once.
        peer.until(lambda: len(commands) > 400, "answers")
        stamps = [stamp_ns(message.header) for message in commands]
        assert len(set(stamps)) == len(stamps)
        received = figures(statuses["haptic_device"])
        assert int(received["loop_latency_count"]) <= int(received["periods"])
        expected = "SCHED_FIFO 50" if grants_real_time(50) else "SCHED_OTHER:"
        assert all(
            figures(status)["scheduling"].startswith(expected) for status in statuses.values()
        )
        publish = peer.publisher("mechanism/handle/external_cf", WrenchStamped)

        peer.until(
            lambda: "external_cf" in figures(statuses["mechanism_simulator"])["pushed_by"],
            "a wrench from outside to reach the mechanism",
            doing=lambda: publish.publish(peer.wrench(0.1, 0, 0, 0, 0, 0)),
        )


def test_a_graph_ends_with_its_parent(domain: int, peer: Peer, statuses: Statuses) -> None:
    script = (
        "import os, time\n"
        "from hapticmech_ros.graph.processes import Graph\n"
        f"graph = Graph('five_bar', True, parameters={{'control_rate': {RATE}}})\n"
        "print(next(iter(graph.processes.values())).pid, flush=True)\n"
        "time.sleep(60)\n"
    )
    with program(domain, sys.executable, "-c", script, stdout=subprocess.PIPE) as parent:
        child = int(parent.stdout.readline())
        peer.until(lambda: "haptic_device" in statuses, "the graph")
        parent.kill()
        peer.until(lambda: not _alive(child), "the graph's end")


def _travel(poses: list[PoseStamped]) -> float:
    first, last = poses[0].pose.position, poses[-1].pose.position
    return float(np.hypot(last.x - first.x, last.y - first.y))


def _alive(pid: int) -> bool:
    try:
        status = Path(f"/proc/{pid}/stat").read_text()
    except FileNotFoundError:
        return False
    return status.rsplit(")", 1)[1].split()[0] != "Z"


def test_the_run_command_ends_its_graph(domain: int, peer: Peer, statuses: Statuses) -> None:
    """By SIGTERM; by SIGINT: test_documented_commands.py."""
    command = [sys.executable, "-m", "hapticmech_ros", "run", "two_link", "--composed"]
    with program(domain, *command, "--control-rate", f"{RATE:g}") as process:
        peer.until(lambda: set(NODES) <= set(statuses), "the graph")
        # Of what was never rendered the end is no success.
        peer.until(lambda: statuses["haptic_device"].message == "rendering", "a force")
        process.send_signal(signal.SIGTERM)
        assert process.wait(10.0) == 0
        statuses.clear()
        peer.run(1.5)
        assert not statuses
