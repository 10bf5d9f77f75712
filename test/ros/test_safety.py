# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The device's safety envelope over the graph: each cause brings zero force, and says so."""

import math
from pathlib import Path

import numpy as np
import pytest
from geometry_msgs.msg import WrenchStamped
from std_msgs.msg import Float64MultiArray
from std_srvs.srv import SetBool

from hapticmech_ros.nodes.messages import stamp_ns
from hapticmech_ros.wire.messages import LocalFeedbackGain
from ros.harness import Peer, allowing, figures, running, six

pytestmark = pytest.mark.ros
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
        status = self.statuses.get("haptic_device")
        return "" if status is None else figures(status)[name]


def test_commands_that_end_are_at_zero_within_20_ms(domain: int, peer: Peer) -> None:
    with running("haptic_device", domain, **PROMPT):
        bench = Bench(peer)
        # Again where a starved device was at zero before it took the last command.
        for _ in range(5):
            peer.until(bench.pushed, "the push")
            peer.until(bench.zero, "its end")
            after_ns = bench.zero_after_ns(bench.last_ns)
            if after_ns > 0:
                break
        # By the device's own samples: how late a starved machine takes them does not count.
        assert 0 < after_ns <= 20 * MS


@pytest.mark.parametrize("bad", [math.nan, math.inf])
def test_what_is_no_number_never_leaves(domain: int, peer: Peer, bad: float) -> None:
    with running("haptic_device", domain, **PROMPT):
        bench = Bench(peer)
        peer.until(bench.pushed, "the push")
        good_ns = bench.last_ns

        def zero() -> bool:
            bench.send(0.06, bad, 0.0, 0.0, 0.0, 0.0)
            peer.run(0.002)
            return bench.zero()

        peer.until(zero, "zero")
        assert bench.zero_after_ns(good_ns) <= 20 * MS
        peer.until(lambda: bench.figure("refused_messages") not in ("", "0"), "the refusal told")
    assert all(np.isfinite(six(m)).all() for m in bench.applied)


def test_an_emergency_stop_lasts_until_it_is_taken_back(domain: int, peer: Peer) -> None:
    with running("haptic_device", domain, **PROMPT):
        bench = Bench(peer)
        peer.until(bench.pushed, "the push")
        request = SetBool.Request(data=True)
        asked_ns = peer.node.get_clock().now().nanoseconds
        assert peer.call(SetBool, "device/emergency_stop", request).success
        for _ in range(50):
            bench.pushed()
        assert bench.zero()
        assert bench.zero_after_ns(asked_ns) < 20 * MS
        peer.until(lambda: bench.figure("fault") == "emergency stop", "the reason told")
        assert "emergency stop" in bench.statuses["haptic_device"].message
        assert peer.call(SetBool, "device/emergency_stop", SetBool.Request(data=False)).success
        peer.until(bench.pushed, "the push again")


def test_a_second_publisher_is_refused_once_it_speaks(domain: int, peer: Peer) -> None:
    with running("haptic_device", domain, **STILL):
        bench = Bench(peer)
        peer.until(bench.pushed, "the push")
        second = peer.node.create_publisher(WrenchStamped, "device/servo_cf", 10)
        # Who has only made a publisher commands nothing.
        peer.until(lambda: second.get_subscription_count() > 0, "the device")
        peer.until(bench.pushed, "the push beside a silent one")

        def refused() -> bool:
            # With no stamp, as CRTK allows, and the same command.
            message = peer.wrench(*PUSH)
            message.header.stamp.sec = message.header.stamp.nanosec = 0
            second.publish(message)
            bench.pushed()
            return bench.zero() and "more than one publisher" in bench.figure("fault")

        peer.until(refused, "the refusal of two")
        assert "/peer (" in bench.figure("fault")
        peer.until(bench.pushed, "the push of the one that goes on")
        assert bench.figure("fault") is not None


def test_a_second_publisher_of_gains_alone_is_refused_once_it_speaks(
    domain: int, peer: Peer
) -> None:
    topic = "device/local_feedback_gain"

    def gain() -> Float64MultiArray:
        now = peer.node.get_clock().now().nanoseconds
        told = LocalFeedbackGain.answering(now, now, 0.0, np.zeros(108))
        return Float64MultiArray(data=told.values.tolist())

    with running("haptic_device", domain, **STILL):
        bench = Bench(peer)
        own = peer.publisher(topic, Float64MultiArray)

        def pushed() -> bool:
            own.publish(gain())
            return bench.pushed()

        peer.until(pushed, "the push")
        second = peer.node.create_publisher(Float64MultiArray, topic, 10)
        peer.until(lambda: second.get_subscription_count() > 0, "the device")
        peer.until(pushed, "the push beside a silent one")

        def refused() -> bool:
            # As harmless as the other's.
            second.publish(gain())
            pushed()
            return bench.zero() and f"more than one publisher of /{topic}" in bench.figure("fault")

        peer.until(refused, "the refusal of two")
        assert "/peer (" in bench.figure("fault")
        assert " and /peer (" in bench.figure("fault")
        peer.until(pushed, "the push of the one that goes on")


def test_who_takes_over_from_a_silent_publisher_is_obeyed(domain: int, peer: Peer) -> None:
    with running("haptic_device", domain, **STILL):
        bench = Bench(peer)
        peer.until(bench.pushed, "the push")
        peer.until(bench.zero, "its end")
        peer.run(0.2)
        second = peer.node.create_publisher(WrenchStamped, "device/servo_cf", 10)
        bench.command, silent = second, bench.command
        peer.until(bench.pushed, "the push of the other")
        assert bench.figure("fault") == ""

        # Until the first one speaks again.
        def refused() -> bool:
            second.publish(peer.wrench(*PUSH))
            silent.publish(peer.wrench(*PUSH))
            peer.run(0.002)
            return bench.zero() and "more than one publisher" in bench.figure("fault")

        peer.until(refused, "the refusal of two")


def test_limits_slew_ramp_and_workspace_hold_and_are_told(
    domain: int, peer: Peer, tmp_path: Path
) -> None:
    limits = {
        "force_limit": 2.0,
        "torque_limit": 0.01,
        # Less than the ramp asks for: 2 N in 0.05 s.
        "force_slew": 20.0,
        "start_ramp": 0.05,
        "workspace_radius": 0.005,
    }
    scene = allowing(tmp_path, start_ramp=0.05)
    with running("haptic_device", domain, scene, **STILL, **limits):
        bench = Bench(peer)
        peer.until(lambda: bench.applied, "samples")

        def led() -> bool:
            bench.send(5.0, 0.0, 0.0, 0.0, 0.0, 0.5)
            peer.run(0.002)
            return bench.figure("limited_by_workspace") not in ("", "0")

        peer.until(led, "the end of the workspace")
        told = {
            name: int(bench.figure(f"limited_by_{name}")) for name in ("force_limit", "force_slew")
        }
    given = np.array([six(m) for m in bench.applied])
    assert 0.1 < np.linalg.norm(given[:, :3], axis=1).max() <= 2.0 * (1 + 1e-12)
    assert np.abs(given[:, 3:]).max() <= 0.01 * (1 + 1e-12)
    assert all(count > 0 for count in told.values())
