# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A machine's clock that is set to what no stamp can tell, and back: nobody is under a force."""

from __future__ import annotations

import mmap
import struct
import sys
import time
from pathlib import Path

import pytest
from std_msgs.msg import Float64MultiArray

from hapticmech_ros.graph.processes import ros_arguments
from hapticmech_ros.numerics.times import NANOSECONDS
from hapticmech_ros.wire.bounds import read
from hapticmech_ros.wire.messages import DeviceStateMessage
from hapticmech_ros.wire.stamped import LAST_NS, LAST_SECOND
from ros.harness import Peer, Statuses, figures, program

HOUR_S = 3600
# The four nodes, whose clock is ahead by the nanoseconds that a file says.
GRAPH = """
import mmap, struct, sys, time
from hapticmech_ros.nodes.entry import composed
with open(sys.argv.pop(1), "rb") as file:
    ahead = mmap.mmap(file.fileno(), 8, access=mmap.ACCESS_READ)
real = time.time_ns
time.time_ns = lambda: real() + struct.unpack("q", ahead)[0]
composed()
"""


@pytest.mark.parametrize("beyond_s", [HOUR_S, -HOUR_S], ids=["after 2038", "before 1970"])
def test_the_device_is_at_zero_until_the_clock_is_right_and_then_renders(
    domain: int, peer: Peer, statuses: Statuses, tmp_path: Path, beyond_s: int
) -> None:
    path = tmp_path / "ahead"
    path.write_bytes(bytes(8))
    samples = peer.listen("device/state", Float64MultiArray)
    given = {"scene": "five_bar", "diagnostics_period": 0.05, "transport": "middleware"}
    command = [sys.executable, "-c", GRAPH, str(path), *ros_arguments(given)]
    edge_s = LAST_SECOND if beyond_s > 0 else 0
    ahead_ns = (edge_s + beyond_s) * NANOSECONDS - time.time_ns()

    def last() -> DeviceStateMessage:
        return read(DeviceStateMessage, samples[-1].data)

    def pushed() -> bool:
        return bool(samples) and last().applied.any()

    with (
        program(domain, *command) as process,
        path.open("r+b") as file,
        mmap.mmap(file.fileno(), 8) as ahead,
    ):
        peer.until(pushed, "the push")
        seen = len(samples)
        ahead[:] = struct.pack("q", ahead_ns)
        peer.until(
            lambda: len(samples) > seen and not last().applied.any(), "the zero of the device"
        )
        # While it fails and begins anew, time and again.
        peer.run(1.5)
        assert process.poll() is None
        assert not last().applied.any()
        assert last().stamp_ns == (LAST_NS if beyond_s > 0 else 0)
        told = figures(statuses["haptic_device"])
        assert "builtin_interfaces/Time" in told["last_failure"]
        assert told["clock_steps"] == "1"
        ahead[:] = bytes(8)
        peer.until(pushed, "the push after it")
        peer.until(
            lambda: statuses["teleoperation_controller"].message == "engaged", "the engagement"
        )
        assert process.poll() is None
