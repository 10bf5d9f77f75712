# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""``hapticmech run``: how long it runs, what it starts again, and what it takes as names."""

import os
import signal
import subprocess
import sys
import time
from contextlib import AbstractContextManager
from pathlib import Path
from shutil import copy

import pytest
from std_msgs.msg import Float64MultiArray

from benchmarks.children import wait_until
from hapticmech_ros.bag import BagReader
from hapticmech_ros.loading import find_scene
from hapticmech_ros.system.readiness import ADDRESS, Readiness
from ros.harness import RATE, WAIT_S, Peer, child_of, program

COMMAND = [sys.executable, "-m", "hapticmech_ros"]


def running(
    domain: int, *options: str, **environment: str
) -> AbstractContextManager[subprocess.Popen[str]]:
    command = [*COMMAND, "run", "--control-rate", f"{RATE:g}", *options]
    output = {"stdout": subprocess.PIPE, "stderr": subprocess.STDOUT}
    return program(domain, *command, environment=environment, **output)


def ended(domain: int, *options: str, **environment: str) -> tuple[int, str]:
    """Return exit code and output of a run that ends by itself."""
    with running(domain, *options, **environment) as process:
        output, _ = process.communicate(timeout=4 * WAIT_S)
        return process.returncode, output


def test_a_duration_counts_from_when_all_nodes_are_up(domain: int, tmp_path: Path) -> None:
    """Importing and discovery take a second, on a busy machine many."""
    bag, readiness = tmp_path / "bag", Readiness()
    options = ["five_bar", "--duration", "3", "--record", str(bag)]
    with running(domain, *options, **{ADDRESS: readiness.address}) as process:
        # It is a service itself, and says that all its nodes are up.
        wait_until(readiness.pids, 4.0 * WAIT_S, "the graph to be up")
        up = time.monotonic()
        output, _ = process.communicate(timeout=4 * WAIT_S)
        # What it said was seen a little later, on a busy machine by some tenths of a second.
        assert time.monotonic() - up > 3.0 - 0.5
        assert process.returncode == 0, output
        assert readiness.pids() == {process.pid}
    readiness.close()
    with BagReader(bag) as reader:
        times = [time_ns for _, time_ns, _ in reader.serialized("/device/state")]
    # The duration begins when the recorder hears the graph.
    assert 1e-9 * (times[-1] - times[0]) > 3.0 - 0.5


def test_a_node_that_was_up_is_started_again(domain: int, peer: Peer) -> None:
    models = peer.listen("analysis/handle/operational_model", Float64MultiArray)
    with running(domain, "five_bar", "--respawn") as process:
        peer.until(lambda: len(models) > 10, "a model", 3 * WAIT_S)
        node = child_of(process.pid, b"nullspace_analyser")
        # 0 would be the test's own processes.
        assert node
        os.kill(node, signal.SIGKILL)
        peer.until(lambda: child_of(process.pid, b"nullspace_analyser"), "a new process")
        models.clear()
        peer.until(lambda: len(models) > 10, "a model again", 3 * WAIT_S)
        process.send_signal(signal.SIGINT)
        output, _ = process.communicate(timeout=WAIT_S)
        assert process.returncode == 0
    assert "nullspace_analyser ended by itself: signal 9: it is started again" in output


def test_a_node_that_never_was_up_is_not_started_again(domain: int, tmp_path: Path) -> None:
    code, output = ended(domain, "five_bar", "--respawn", "--set", "haptic_device.view_rate=-1.0")
    assert code == 1
    assert "haptic_device ended by itself" in output
    assert "started again" not in output


def test_a_path_may_have_an_apostrophe_and_spaces(domain: int, tmp_path: Path) -> None:
    place = tmp_path / "somebody's own scenes"
    place.mkdir()
    copy(find_scene("two_link"), place / "it's.yaml")
    options = "--only", "mechanism_simulator", "--duration", "0.5"
    code, output = ended(domain, str(place / "it's.yaml"), *options)
    assert code == 0, output


@pytest.mark.parametrize("namespace", ["two words", "a//b"])
def test_a_namespace_that_ros_does_not_have_is_refused(domain: int, namespace: str) -> None:
    code, output = ended(domain, "five_bar", "--namespace", namespace)
    assert code == 1
    assert "namespace: must be names of letters" in output
    assert "Traceback" not in output
