# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What `ros2 run` starts: found through ament, run for real, ended by a signal."""

import signal
import sys
from pathlib import Path

import pytest
from ament_index_python.packages import get_package_prefix

from hapticmech_ros.nodes.entry import NODES
from ros.harness import Peer, Statuses, program


@pytest.mark.parametrize("name", list(NODES))
def test_executable_in_lib_runs_as_a_node(
    domain: int, peer: Peer, statuses: Statuses, name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("AMENT_PREFIX_PATH", sys.prefix)
    executable = Path(get_package_prefix("hapticmech_ros")) / "lib" / "hapticmech_ros" / name
    with program(domain, executable, "--ros-args", "-p", "scene:=two_link") as process:
        peer.until(lambda: name in statuses, f"diagnostics of {name}")
        assert statuses[name].hardware_id == "two_link"
        process.send_signal(signal.SIGINT)
        assert process.wait(10.0) == 0
