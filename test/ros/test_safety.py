# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The device's safety envelope over the graph: each cause brings zero force, and says so."""

import math
import signal
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from geometry_msgs.msg import WrenchStamped
from std_srvs.srv import SetBool

from hapticmech_ros.graph.processes import (
    private_environment,
    ros_arguments,
    start_process,
    stop_process,
)
from hapticmech_ros.nodes.messages import stamp_ns
from ros.harness import RATE, Peer, Statuses, running, six, unstamped
from ros.standing_device import STANDS_S

MS = 1_000_000
# Nothing pushes but the commands; what the actuators apply is told at every sample.
STILL = {"wait_for_start": True, "view_rate": 1000.0, "diagnostics_period": 0.05}
# The scene's rate, 1 kHz, at which 20 ms are promised.
PROMPT = {**STILL, "control_rate": 0.0}
PUSH = (0.06, 0.0, 0.0, 0.0, 0.0, 0.002)


class Bench:
    """A device that somebody commands."""

    def __init__(self, peer: Peer) -> None:
        self.peer = peer
        self.applied = peer.listen("device/setpoint_cf", WrenchStamped)
        self.statuses = peer.statuses()
        self.command = peer.publisher("device/servo_cf", WrenchStamped)
        self.last_ns = 0

    def send(self, *values: float) -> None:
        """Command a wrench, stamped now."""
        message = self.peer.wrench(*(values or PUSH))
        self.last_ns = stamp_ns(message.header)
        self.command.publish(message)

    def pushed(self) -> bool:
        """Command, and return whether the actuators do it by now."""
        self.send()
        self.peer.run(0.002)
        return bool(self.applied) and six(self.applied[-1]) == list(PUSH)

    def zero(self) -> bool:
        """Return whether the actuators are at zero by now."""
        return not any(six(self.applied[-1]))

    def zero_after_ns(self, cause_ns: int) -> int:
        """Return the time from a cause to the first sample at zero that stays there."""
        last = max(stamp_ns(m.header) for m in self.applied if any(six(m)))
        first = min(stamp_ns(m.header) for m in self.applied if stamp_ns(m.header) > last)
        return first - cause_ns

    def figure(self, name: str) -> str:
        """Return a figure of the device's diagnostics."""
        return self.statuses.figure("haptic_device", name)


@pytest.fixture
def bench(domain: int, peer: Peer) -> Iterator[Bench]:
    with running("haptic_device", domain, **PROMPT):
        yield Bench(peer)


def test_commands_that_end_are_at_zero_within_20_ms(bench: Bench, peer: Peer) -> None:
    # Again where a starved device was at zero before it took the last command.
    for _ in range(5):
        peer.until(bench.pushed, "the push")
        peer.until(bench.zero, "its end")
        after_ns = bench.zero_after_ns(bench.last_ns)
        if after_ns > 0:
            break
    # By the device's own samples: how late a starved machine takes them does not count.
    assert 0 < after_ns <= 20 * MS


def test_what_is_no_number_never_leaves(bench: Bench, peer: Peer) -> None:
    peer.until(bench.pushed, "the push")
    good_ns = bench.last_ns
    peer.until(bench.zero, "zero", doing=lambda: bench.send(0.06, math.nan, 0.0, 0.0, 0.0, 0.0))
    assert bench.zero_after_ns(good_ns) <= 20 * MS
    peer.until(lambda: bench.figure("refused_messages") not in ("", "0"), "the refusal told")
    assert all(np.isfinite(six(m)).all() for m in bench.applied)


def test_an_emergency_stop_lasts_until_it_is_taken_back(bench: Bench, peer: Peer) -> None:
    peer.until(bench.pushed, "the push")
    asked_ns = peer.node.get_clock().now().nanoseconds
    assert peer.call(SetBool, "device/emergency_stop", SetBool.Request(data=True)).success
    for _ in range(50):
        bench.pushed()
    assert bench.zero()
    assert bench.zero_after_ns(asked_ns) < 20 * MS
    peer.until(lambda: bench.figure("fault") == "emergency stop", "the reason told")
    assert "emergency stop" in bench.statuses.sentence("haptic_device")
    assert peer.call(SetBool, "device/emergency_stop", SetBool.Request(data=False)).success
    peer.until(bench.pushed, "the push again")


def test_a_second_publisher_is_refused_once_it_speaks(bench: Bench, peer: Peer) -> None:
    peer.until(bench.pushed, "the push")
    second = peer.node.create_publisher(WrenchStamped, "device/servo_cf", 10)
    # Who has only made a publisher commands nothing.
    peer.until(lambda: second.get_subscription_count() > 0, "the device")
    peer.until(bench.pushed, "the push beside a silent one")

    def refused() -> bool:
        # With no stamp, as CRTK allows, and the same command.
        second.publish(unstamped(*PUSH))
        bench.pushed()
        return bench.zero() and "more than one publisher" in bench.figure("fault")

    peer.until(refused, "the refusal of two")
    assert "/peer (" in bench.figure("fault")
    peer.until(bench.pushed, "the push of the one that goes on")


def test_a_device_that_nobody_could_stop_ends_its_force_until_it_listens_again(
    domain: int, peer: Peer, statuses: Statuses
) -> None:
    others = "mechanism_simulator,nullspace_analyser,teleoperation_controller"
    arguments = ros_arguments({"scene": "five_bar", "control_rate": RATE})
    command = [sys.executable, str(Path(__file__).with_name("standing_device.py")), *arguments]
    applied = peer.listen("device/measured_cf", WrenchStamped)
    with running(others, domain), start_process(command, private_environment(domain)) as device:
        try:
            ended_ns = []
            for _ in range(6):
                peer.until(lambda: statuses.well("haptic_device"), "rendering")
                peer.until(lambda: any(six(applied[-1])), "a force")
                applied.clear()
                begun_ns = peer.node.get_clock().now().nanoseconds
                device.send_signal(signal.SIGUSR1)
                peer.until(lambda: applied and not any(six(applied[-1])), "its end")
                after_ns = stamp_ns(applied[-1].header) - begun_ns
                # A force that had ended before the signal did not end because of it: again.
                if after_ns > 0:
                    assert 70 * MS < after_ns < 500 * MS < STANDS_S * 1e9, ended_ns
                    ended_ns.append(after_ns)
                peer.until(
                    lambda: any(six(applied[-1])), "a force once it listens again", timeout=10.0
                )
                if len(ended_ns) == 2:
                    break
            assert len(ended_ns) == 2
        finally:
            stop_process(device)
