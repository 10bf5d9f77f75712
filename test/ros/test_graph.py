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
from std_msgs.msg import Float64MultiArray, UInt8

from hapticmech_ros.graph import Graph, private_environment, stop_process
from hapticmech_ros.nodes.entry import NODES
from hapticmech_ros.nodes.messages import stamp_ns
from hapticmech_ros.wire.bounds import read
from hapticmech_ros.wire.messages import OperationalModelMessage
from real_time import grants_real_time
from ros.harness import RATE, Peer, figures, running, six

pytestmark = pytest.mark.ros
# With a machine that has other work.
PATIENT = {
    "teleoperation_controller.input_timeout": 0.1,
    "haptic_device.command_timeout": 0.1,
    "control_rate": RATE,
}


@pytest.mark.parametrize("composed", [False, True], ids=["four_processes", "composed"])
def test_the_hand_moves_the_mechanism(domain: int, peer: Peer, composed: bool) -> None:
    device = peer.listen("device/measured_cp", PoseStamped)
    point = peer.listen("mechanism/handle/measured_cp", PoseStamped)
    counts = peer.listen("analysis/handle/constraint_count", UInt8)
    statuses = peer.statuses()
    environment = private_environment(domain)
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


@pytest.mark.parametrize("victim", list(NODES))
def test_a_node_dies_and_comes_back(domain: int, peer: Peer, victim: str) -> None:
    commands = peer.listen("device/servo_cf", WrenchStamped)
    forces = peer.listen("device/hand/measured_cf", WrenchStamped)
    models = peer.listen("analysis/handle/operational_model", Float64MultiArray)
    parameters, environment = {"control_rate": RATE}, private_environment(domain)
    with Graph("five_bar", parameters=parameters, environment=environment) as graph:
        peer.until(lambda: forces and six(forces[-1])[0] == -0.5, "the hand pushing")
        graph.processes[victim].kill()
        graph.processes[victim].wait()
        if victim != "haptic_device":
            # No commands, so the hand lets go, and the actuators are at zero.
            peer.until(lambda: six(forces[-1]) == [0.0] * 6, "the hand letting go", 3.0)
        with running(victim, domain):
            seen = len(commands)
            peer.until(lambda: len(commands) > seen + 200, "commands again")
            peer.until(lambda: six(forces[-1])[0] == -0.5, "the hand pushing again")
            peer.until(lambda: models, "renderings")
    assert all(np.isfinite(six(m)).all() for m in commands)
    assert read(OperationalModelMessage, models[-1].data).count >= 1


def test_composed_nodes_hear_each_other_once_and_others_too(domain: int, peer: Peer) -> None:
    commands = peer.listen("device/servo_cf", WrenchStamped)
    statuses = peer.statuses()
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

        def pushed() -> bool:
            publish.publish(peer.wrench(0.1, 0, 0, 0, 0, 0))
            return "external_cf" in figures(statuses["mechanism_simulator"])["pushed_by"]

        peer.until(pushed, "a wrench from outside to reach the mechanism")


def test_nodes_start_in_any_order(domain: int, peer: Peer) -> None:
    commands = peer.listen("device/servo_cf", WrenchStamped)
    with running("teleoperation_controller", domain), running("nullspace_analyser", domain):
        peer.run(0.5)
        with running("haptic_device", domain):
            peer.run(0.5)
            assert not commands
            with running("mechanism_simulator", domain):
                peer.until(lambda: len(commands) > 100, "commands")


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
@pytest.mark.parametrize("name", list(NODES))
def test_signals_end_a_node_with_exit_code_zero(
    domain: int, peer: Peer, name: str, number: signal.Signals
) -> None:
    statuses = peer.statuses()
    with running(name, domain) as process:
        peer.until(lambda: name in statuses, "the node")
        process.send_signal(number)
        process.send_signal(number)
        assert process.wait(10.0) == 0


def test_two_graphs_in_namespaces_do_not_mix(domain: int, peer: Peer) -> None:
    left = peer.listen("/left/device/measured_cp", PoseStamped)
    right = peer.listen("/right/device/measured_cp", PoseStamped)
    rest = peer.listen("/device/measured_cp", PoseStamped)
    given: dict = {"parameters": {"control_rate": RATE}, "environment": private_environment(domain)}
    one = Graph("five_bar", True, "left", **given)
    try:
        with Graph("two_link", True, "right", **given):
            peer.until(lambda: left and right, "both devices")
    finally:
        one.stop()
    assert not rest


def test_a_bad_scene_ends_the_node_with_a_clear_message(domain: int) -> None:
    with running("haptic_device", domain, scene="no_such_scene") as process:
        assert process.wait(20.0) == 1


def test_a_graph_ends_with_its_parent(domain: int, peer: Peer) -> None:
    statuses = peer.statuses()
    script = (
        "import os, time\n"
        "from hapticmech_ros.graph import Graph\n"
        f"graph = Graph('five_bar', True, parameters={{'control_rate': {RATE}}})\n"
        "print(next(iter(graph.processes.values())).pid, flush=True)\n"
        "time.sleep(60)\n"
    )
    parent = subprocess.Popen(
        [sys.executable, "-c", script],
        env=private_environment(domain),
        stdout=subprocess.PIPE,
        text=True,
    )
    try:
        assert parent.stdout is not None
        child = int(parent.stdout.readline())
        peer.until(lambda: "haptic_device" in statuses, "the graph")
        parent.kill()
        peer.until(lambda: not _alive(child), "the graph's end")
    finally:
        stop_process(parent)


def _travel(poses: list[PoseStamped]) -> float:
    first, last = poses[0].pose.position, poses[-1].pose.position
    return float(np.hypot(last.x - first.x, last.y - first.y))


def _alive(pid: int) -> bool:
    try:
        status = Path(f"/proc/{pid}/stat").read_text()
    except FileNotFoundError:
        return False
    return status.rsplit(")", 1)[1].split()[0] != "Z"


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_the_run_command_ends_its_graph(domain: int, peer: Peer, number: signal.Signals) -> None:
    statuses = peer.statuses()
    command = [sys.executable, "-c", "from hapticmech_ros.cli import main; main()"]
    process = subprocess.Popen(
        [*command, "run", "two_link", "--composed", "--control-rate", f"{RATE:g}"],
        env=private_environment(domain),
    )
    try:
        peer.until(lambda: set(NODES) <= set(statuses), "the graph")
        # Of what was never rendered the end is no success.
        peer.until(lambda: statuses["haptic_device"].message == "rendering", "a force")
        process.send_signal(number)
        assert process.wait(10.0) == 0
        statuses.clear()
        peer.run(1.5)
        assert not statuses
    finally:
        stop_process(process)
